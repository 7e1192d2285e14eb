"""What a rendering gives: the picture, the maps behind it, and what was decided on the way."""

from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.errors import ImageFileError
from bokehnet.io.color.color_space import LINEAR_REC709, convert
from bokehnet.io.frame import Frame, write_frame
from bokehnet.io.image import write_image, write_map
from bokehnet.optics.pixels.pixel_filter import FilterChoice
from bokehnet.progress import Progress
from bokehnet.render.notebook import shown_html
from bokehnet.render.output import make_output_format
from bokehnet.settings.error_names import errors_named_as
from bokehnet.settings.settings import OutputSettings, RenderSettings
from bokehnet.settings.settings_file import save_settings

__all__ = ["LEVELS_SHOWN", "RenderReport", "RenderResult"]

Array = npt.NDArray[np.float32]

# Expected error that is white in its picture, 8-bit levels.
LEVELS_SHOWN = 16.0


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderReport:
    """What was decided.

    Attributes:
        engine: What rendered.
        largest_blur: Largest blur radius, pixels.
        repaired: Whether edges of the map were moved; None where nobody looked.
        repair_reason: Why, in a few words.
        focus_disparity: What stays sharp, in the unit of the map, the near end of a range; None where defocus
            was given.
        focus_distance: The same in metres; None where distances are not known.
        pixel_filter: By which pixels at edges were taken to mix both sides; None where none was parted.
        notes: What was chosen, or looks odd, a line each.

    Examples:
        >>> report = RenderReport(engine="scatter", largest_blur=12.5, focus_distance=2.0)
        >>> f"{report.engine}: up to {report.largest_blur} pixels, focus at {report.focus_distance} m"
        'scatter: up to 12.5 pixels, focus at 2.0 m'
    """

    engine: str
    largest_blur: float
    repaired: bool | None = None
    repair_reason: str = ""
    focus_disparity: float | None = None
    focus_distance: float | None = None
    pixel_filter: FilterChoice | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RenderResult:
    """A rendered picture and what it was made of; all scene-linear float32 in the primaries of its file.

    Attributes:
        bokeh: The result, (H, W, 3), after the effects of the camera.
        alpha: Its coverage, (H, W); None where all is covered.
        classical: The classical half, (H, W, 3), before the effects; None where a hybrid was rendered in
            strips.
        neural: The neural half, (H, W, 3); None for a classical engine, and in strips.
        error_map: The blend, (H, W) in [0, 1], 1 = neural: the learned map within the reach of a depth
            discontinuity, 0 elsewhere; for a classical engine, where it can be wrong.
        defocus: Signed blur radius of each pixel, (H, W), pixels; None where its memory was used again.
        mixed_pixels: Pixels that were rendered as two surfaces, with both; None for engines that part none.
        expected_error: What is expected of the mean over colours of |sRGB value - truth|, 8-bit levels, (H,
            W), before the effects; None where it was not asked for.
        supersampled: How many times the size of the result the picture is in which these pixels lie.
        report: What was decided.
        frame: What the picture's file holds besides; None for arrays.
        output: How the picture is written.

    Examples:
        >>> from bokehnet.render.renderer import BokehRenderer
        >>> picture, defocus = np.ones((24, 32, 3), np.float32), np.full((24, 32), 4, np.float32)
        >>> result = BokehRenderer("scatter").render(picture, defocus)
        >>> result._repr_html_()[-59:]  # what a notebook shows below the picture
        'scatter, 32x24, blur up to 4.0 pixels</figcaption></figure>'
        >>> result.save_maps("maps")
        >>> sorted(path.name for path in Path("maps").iterdir())
        ['classical.png', 'defocus.exr', 'defocus.png', 'error_map.png']
    """

    bokeh: Array
    classical: Array | None
    neural: Array | None
    error_map: Array
    report: RenderReport
    alpha: Array | None = None
    defocus: Array | None = None
    mixed_pixels: KnownSurfaces | None = None
    expected_error: Array | None = None
    supersampled: int = 1
    frame: Frame | None = field(default=None, repr=False)
    output: OutputSettings = field(default_factory=OutputSettings)

    def save(self, path: Path | str, progress: Progress | None = None) -> None:
        """Write the picture as ``output`` says, atomically; the extension picks the format.

        In the place of the picture in an EXR file, all else in the file stays; see
        :func:`bokehnet.io.frame.write_frame`. Where ``output.expected_error`` is on, EXR files have it as a
        channel of that name, in 8-bit levels.

        Args:
            path: Where it goes.
            progress: Called with (steps done, steps in all), by several threads.

        Raises:
            ImageFileError: Unknown extension, or the file cannot be written.
            ParameterError: The format cannot be as ``output`` says.
        """
        wanted, beside = make_output_format(self.output), {}
        if self.output.expected_error == "on" and Path(path).suffix.lower() == ".exr":
            beside = {} if self.expected_error is None else {"expected_error": self.expected_error}
        with errors_named_as("output"):
            if self.frame is None:
                write_image(path, self.bokeh, alpha=self.alpha, **asdict(wanted), extra_channels=beside)
            else:
                write_frame(path, self.frame, self.bokeh, self.alpha, wanted, progress, beside)

    def save_maps(self, folder: Path | str, settings: RenderSettings | None = None) -> None:
        """Write what the result was made of; defocus as a grey picture, 0.5 = sharp, and exact as EXR.

        So is the expected error: its picture is white from ``LEVELS_SHOWN`` 8-bit levels on.

        Pixels that were rendered as two surfaces are shown by their coverage (1 where there is one), and by
        the colours of the front and of the back, where all else is transparent.

        Args:
            folder: Made if it is not there.
            settings: Written beside the maps, as ``settings.toml``.

        Raises:
            ImageFileError: A file cannot be written.
        """
        folder = Path(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ImageFileError(f"cannot make the folder {folder}: {error.strerror}") from error
        if self.defocus is not None:
            largest = max(self.report.largest_blur, 1e-6)
            write_map(folder / "defocus.exr", self.defocus)
            write_map(folder / "defocus.png", 0.5 + 0.5 * self.defocus / largest)
        write_map(folder / "error_map.png", self.error_map)
        if self.classical is not None:
            write_image(folder / "classical.png", self._in_rec709(self.classical))
        if self.neural is not None:
            write_image(folder / "neural.png", self._in_rec709(self.neural))
        if self.expected_error is not None:
            write_map(folder / "expected_error.exr", self.expected_error)
            write_map(folder / "expected_error.png", np.minimum(self.expected_error / LEVELS_SHOWN, 1))
        if self.mixed_pixels is not None:
            self._save_surfaces(folder, self.mixed_pixels)
        if settings is not None:
            save_settings(folder / "settings.toml", settings)

    def _save_surfaces(self, folder: Path, mixed: KnownSurfaces) -> None:
        height, width = (self.supersampled * side for side in self.bokeh.shape[:2])
        coverage, parted = np.ones((height, width), np.float32), np.zeros((height, width), np.float32)
        coverage[mixed.rows, mixed.columns], parted[mixed.rows, mixed.columns] = mixed.coverage, 1.0
        write_map(folder / "coverage.png", coverage)
        for name, colors in (("front", mixed.front), ("back", mixed.back)):
            if colors is not None:
                light = np.zeros((height, width, 3), np.float32)
                light[mixed.rows, mixed.columns] = colors
                write_image(folder / f"{name}.png", self._in_rec709(light), alpha=parted)

    def _repr_html_(self) -> str:
        """What a notebook shows: the picture, and below it what was decided."""
        report = self.report
        height, width = self.bokeh.shape[:2]
        lines = [f"{report.engine}, {width}x{height}, blur up to {report.largest_blur:.1f} pixels"]
        if report.focus_distance is not None:
            lines[0] += f", focus at {report.focus_distance:.3g} m"
        elif report.focus_disparity is not None:
            lines[0] += f", focus at disparity {report.focus_disparity:.3g}"
        return shown_html(self._in_rec709(self.bokeh), [*lines, *report.notes])

    def _in_rec709(self, image: Array) -> Array:
        return image if self.frame is None else convert(image, self.frame.space, LINEAR_REC709)

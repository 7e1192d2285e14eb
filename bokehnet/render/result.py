"""Result of a render: the picture, the intermediate maps, and a report."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np
import numpy.typing as npt

from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.errors import ImageFileError
from bokehnet.io.color.color_space import LINEAR_REC709, convert
from bokehnet.io.files.buffers import write_to_stream
from bokehnet.io.frame import Frame, write_frame
from bokehnet.io.image import write_image, write_map
from bokehnet.optics.pixels.pixel_filter import FilterChoice
from bokehnet.progress import Progress
from bokehnet.render.notebook import shown_html
from bokehnet.render.output import make_output_format
from bokehnet.settings.error_names import errors_named_as
from bokehnet.settings.settings import OutputSettings, RenderSettings
from bokehnet.settings.settings_file import save_settings

__all__ = ["MAX_SHOWN_LEVELS", "RenderReport", "RenderResult"]

Array = npt.NDArray[np.float32]

# Expected error at white in its picture, 8-bit levels.
MAX_SHOWN_LEVELS = 16.0


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderReport:
    """Report of a render.

    Attributes:
        engine: Name of the engine.
        largest_blur: Largest blur radius, pixels.
        repaired: True if edges of the map were moved; None if the repair did not run.
        repair_reason: Reason of the repair or its absence, a few words.
        focus_disparity: Disparity in focus, in the unit of the map, near end of a range; None for a defocus
            map.
        focus_distance: Distance in focus, metres, near end of a range; None for relative disparity.
        focus_far_disparity, focus_far_distance: The same of the far end of a range; None without a range.
        pixel_filter: Pixel filter for unmixing at edges; None if the engine does no unmixing.
        notes: Automatic choices and warnings, one line each.
        assumptions: Values and facts that neither settings nor files define, a few words each: focus,
            strength of the blur; unit, direction, coding and holes of the map.
        light: Recovered light of clipped pixels, a few words; empty if none was recovered.

    Examples:
        >>> report = RenderReport(engine="scatter", largest_blur=12.5, focus_distance=2.0)
        >>> f"{report.engine}: up to {report.largest_blur} pixels, focus at {report.focus_distance} m"
        'scatter: up to 12.5 pixels, focus at 2.0 m'
        >>> report.focus_text
        'focus at 2 m'
    """

    engine: str
    largest_blur: float
    repaired: bool | None = None
    repair_reason: str = ""
    focus_disparity: float | None = None
    focus_distance: float | None = None
    focus_far_disparity: float | None = None
    focus_far_distance: float | None = None
    pixel_filter: FilterChoice | None = None
    notes: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    light: str = ""

    @property
    def focus_text(self) -> str:
        """Focus in a few words: metres or disparity, both ends of a range; empty for a defocus map."""
        if self.focus_distance is not None:
            near, far, unit = self.focus_distance, self.focus_far_distance, " m"
        elif self.focus_disparity is not None:
            near, far, unit = self.focus_disparity, self.focus_far_disparity, ""
        else:
            return ""
        if far is None or f"{far:.3g}" == f"{near:.3g}":
            return f"focus at {near:.3g}{unit}"
        low, high = sorted((near, far))
        return f"sharp from {low:.3g} to {high:.3g}{unit}"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RenderResult:
    """Rendered picture and intermediate maps; scene-linear float32 in the primaries of its file.

    Attributes:
        bokeh: Result, (H, W, 3), after the camera effects.
        alpha: Coverage of the result, (H, W); None if all is covered.
        classical: Classical half, (H, W, 3), before the camera effects; None for a hybrid in strips.
        neural: Neural half, (H, W, 3); None for a classical engine, and in strips.
        error_map: Blend, (H, W) in [0, 1], 1 = neural: the learned map within reach of a depth discontinuity,
            0 elsewhere; for a classical engine the places where it can be wrong.
        defocus: Signed blur radius of each pixel, (H, W), pixels; None if its memory was reused.
        mixed_pixels: Pixels rendered as two surfaces, with both; None for engines without unmixing.
        expected_error: Expected mean over colours of |sRGB value - truth|, 8-bit levels, (H, W), before the
            camera effects; None if not requested.
        supersampled: Size of the picture with ``mixed_pixels`` relative to the result.
        report: Report of the render.
        frame: Further content of the picture's file; None for arrays.
        output: Output settings.

    Examples:
        >>> from bokehnet.render.renderer import BokehRenderer
        >>> picture, defocus = np.ones((24, 32, 3), np.float32), np.full((24, 32), 4, np.float32)
        >>> result = BokehRenderer("scatter").render_arrays(picture, defocus)
        >>> result  # in a notebook: the picture, with this text below
        <RenderResult: scatter, 32x24, blur up to 4.0 pixels>
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

    def save(
        self, path: Path | str | BinaryIO, progress: Progress | None = None, *, format: str | None = None
    ) -> None:
        """Write the picture according to ``output``, atomically; the extension sets the format.

        In an EXR file the result replaces the picture and everything else is kept; see
        :func:`bokehnet.io.frame.write_frame`. With ``output.expected_error`` on, EXR files contain it as a
        channel of that name, in 8-bit levels.

        Args:
            path: Output file, or a binary stream such as ``io.BytesIO``.
            progress: Called with (steps done, total steps), by several threads.
            format: Extension that selects the format of a stream, such as "jpg".

        Raises:
            ImageFileError: Unknown extension, or the file cannot be written.
            ParameterError: The format does not support the settings of ``output``.
        """
        if hasattr(path, "write"):
            write_to_stream(cast(BinaryIO, path), format, lambda file: self.save(file, progress))
            return
        output_format, extra = make_output_format(self.output), {}
        if self.output.expected_error == "on" and Path(path).suffix.lower() == ".exr":
            extra = {} if self.expected_error is None else {"expected_error": self.expected_error}
        with errors_named_as("output"):
            if self.frame is None:
                write_image(path, self.bokeh, alpha=self.alpha, **asdict(output_format), extra_channels=extra)
            else:
                write_frame(path, self.frame, self.bokeh, self.alpha, output_format, progress, extra)

    def save_maps(self, folder: Path | str, settings: RenderSettings | None = None) -> None:
        """Write the intermediate maps; defocus as a grey picture, 0.5 = sharp, and exactly as EXR.

        The expected error is written likewise: its picture is white at ``MAX_SHOWN_LEVELS`` 8-bit levels.

        Pixels rendered as two surfaces are shown by their coverage (1 elsewhere), and by the colours of
        foreground and background, transparent elsewhere.

        Args:
            folder: Output folder, created if missing.
            settings: Settings to write to ``settings.toml`` in the folder.

        Raises:
            ImageFileError: A file cannot be written.
        """
        folder = Path(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ImageFileError(f"cannot create the folder {folder}: {error.strerror}") from error
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
            write_map(folder / "expected_error.png", np.minimum(self.expected_error / MAX_SHOWN_LEVELS, 1))
        if self.mixed_pixels is not None:
            self._save_surfaces(folder, self.mixed_pixels)
        if settings is not None:
            save_settings(folder / "settings.toml", settings)

    def _save_surfaces(self, folder: Path, mixed: KnownSurfaces) -> None:
        height, width = (self.supersampled * side for side in self.bokeh.shape[:2])
        coverage, is_mixed = np.ones((height, width), np.float32), np.zeros((height, width), np.float32)
        coverage[mixed.rows, mixed.columns], is_mixed[mixed.rows, mixed.columns] = mixed.coverage, 1.0
        write_map(folder / "coverage.png", coverage)
        for name, colors in (("front", mixed.front), ("back", mixed.back)):
            if colors is not None:
                light = np.zeros((height, width, 3), np.float32)
                light[mixed.rows, mixed.columns] = colors
                write_image(folder / f"{name}.png", self._in_rec709(light), alpha=is_mixed)

    def __repr__(self) -> str:
        """Return size and report in one line, without the arrays."""
        return f"<RenderResult: {', '.join(self._lines())}>"

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook: the picture with the report below."""
        return shown_html(self._in_rec709(self.bokeh), self._lines())

    def _lines(self) -> list[str]:
        """Return size, engine, blur and focus as the first line, and one line per note."""
        report = self.report
        height, width = self.bokeh.shape[:2]
        line = f"{report.engine}, {width}x{height}, blur up to {report.largest_blur:.1f} pixels"
        return [f"{line}, {report.focus_text}" if report.focus_text else line, *report.notes]

    def _in_rec709(self, image: Array) -> Array:
        return image if self.frame is None else convert(image, self.frame.space, LINEAR_REC709)

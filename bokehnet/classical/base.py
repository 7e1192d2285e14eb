"""What every classical renderer takes and gives, and the table of their names."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from typing import NamedTuple, Protocol, TypedDict, Unpack

import numpy as np

from bokehnet.checks import check_choice, check_floats, check_light, check_map, check_same_size
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.engine_registry import CLASSICAL
from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.pixels.pixel_filter import PixelFilter

__all__ = [
    "ALIGNED",
    "ClassicalOptions",
    "ClassicalRenderer",
    "ClassicalResult",
    "Frame",
    "Place",
    "Strip",
    "check_focuses_alone",
    "check_inputs",
    "make_classical",
]

# Rows at which a picture may be cut into strips: renderers work in blocks of up to so many pixels.
ALIGNED = 128


@dataclass(frozen=True, kw_only=True, slots=True)
class Strip:
    """Where arrays stand that are only some rows of a picture.

    Attributes:
        first: Row of the picture at which the arrays begin; a multiple of ``ALIGNED``.
        last: Row at which they end.
        height: Rows of the whole picture.
        max_coc_radius: Its largest blur radius, rounded up to whole pixels.
        wanted: Rows of the arrays whose result is asked for; the others are there to be looked at.
    """

    first: int
    last: int
    height: int
    max_coc_radius: int
    wanted: slice


class Frame(NamedTuple):
    """Where rows and columns lie in the full-size picture.

    Attributes:
        column: Middle of the picture.
        row: The same, down, counted from the first row that is there.
        scale: One over the half-diagonal in pixels, so that corners are at field position 1.
    """

    column: float
    row: float
    scale: float

    @classmethod
    def of(cls, height: int, width: int, above: int = 0, left: int = 0) -> "Frame":
        """Frame of a full-size picture of which ``above`` rows and ``left`` columns are not there."""
        return cls(0.5 * (width - 1) - left, 0.5 * (height - 1) - above, 2 / math.hypot(width, height))


class Place(NamedTuple):
    """Where the pixels of arrays lie in the shown picture, from whose middle field positions are measured.

    Attributes:
        left: Column of the shown picture at which the arrays begin; negative where they hold more.
        top: Row, likewise.
        width: Of the shown picture, pixels.
        height: The same.
    """

    left: int
    top: int
    width: int
    height: int

    @classmethod
    def whole(cls, height: int, width: int) -> "Place":
        """All that is there is shown."""
        return cls(0, 0, width, height)

    def below(self, rows: int) -> "Place":
        """The place of the same arrays without so many rows."""
        return self._replace(top=self.top + rows)

    @property
    def frame(self) -> Frame:
        """Where rows and columns of the arrays lie in the shown picture."""
        return Frame.of(self.height, self.width, self.top, self.left)


@dataclass(frozen=True, kw_only=True, slots=True)
class ClassicalResult:
    """What a classical renderer gives.

    Attributes:
        bokeh: The rendered picture, scene-linear, (H, W, 3).
        error_map: Where it can be wrong, (H, W) in [0, 1]; 1 = trust a network.
        occluded_background: Colours taken to stand behind each pixel, scene-linear, (H, W, 3); ``None`` if it
            has none.
        disocclusion_weight: Share of each pixel's light that comes from there or from beyond the border, (H,
            W) in [0, 1]; ``None`` if it guesses nothing.
        mixed_pixels: Pixels that were parted into two surfaces, with both; ``None`` if it parts none.
        scatter: What the scatter makes of the picture, (H, W, 3); ``None`` if it was not made beside.
    """

    bokeh: np.ndarray
    error_map: np.ndarray
    occluded_background: np.ndarray | None = None
    disocclusion_weight: np.ndarray | None = None
    mixed_pixels: KnownSurfaces | None = None
    scatter: np.ndarray | None = None

    def rows(self, wanted: slice) -> "ClassicalResult":
        """Some of the rows."""

        def part(array: np.ndarray | None) -> np.ndarray | None:
            return None if array is None else array[wanted]

        return ClassicalResult(
            bokeh=self.bokeh[wanted],
            error_map=self.error_map[wanted],
            occluded_background=part(self.occluded_background),
            disocclusion_weight=part(self.disocclusion_weight),
            mixed_pixels=self.mixed_pixels and self.mixed_pixels.in_rows(wanted.start, wanted.stop),
            scatter=part(self.scatter),
        )

    @property
    def features(self) -> np.ndarray | None:
        """Occluded background, disocclusion weight and error map as one array, (H, W, 5), for networks."""
        if self.occluded_background is None or self.disocclusion_weight is None:
            return None
        return np.dstack([self.occluded_background, self.disocclusion_weight, self.error_map])


class ClassicalOptions(TypedDict, total=False):
    """What a classical renderer may be told besides picture, defocus and aperture.

    Attributes:
        strip: Which rows of a larger picture these are; by default a whole one. Only its wanted rows of the
            result mean anything.
        lens_response: What the lens does beyond focusing; default a perfect lens.
        place: Where the whole picture, of which a strip may be a part, lies in the shown one; default: all of
            it is shown.
        progress: Called with the share of the work that is done, 0 to 1.
        pixel_filter: Of the picture, by which its pixels at edges mix both sides.
        known: Surfaces of pixels at edges that need not be estimated, for renderers that take layers.
        rays_share: Share of the usual rays of a pixel, where several pixels will be reduced to one.
        layers: True layers, for renderers that take layers.
    """

    strip: Strip | None
    lens_response: LensResponse | None
    place: Place | None
    progress: Callable[[float], None] | None
    pixel_filter: PixelFilter
    known: KnownSurfaces | None
    rays_share: float
    layers: Layers | None


class ClassicalRenderer(Protocol):
    """A renderer without learned parts."""

    def __call__(
        self,
        image: np.ndarray,
        defocus: np.ndarray,
        aperture: Aperture | None = None,
        **options: Unpack[ClassicalOptions],
    ) -> ClassicalResult:
        """Render.

        Args:
            image: All-in-focus picture, scene-linear, (H, W, 3), float32.
            defocus: Signed blur radius in pixels, (H, W), positive in front of focus.
            aperture: Shape of the lens opening; default a plain disc.
            options: What else there is to know.
        """
        ...


def make_classical(classical: str) -> ClassicalRenderer:
    """Return the classical renderer of that name; ``ParameterError`` names the choices."""
    check_choice("classical", classical, CLASSICAL)
    module, function = CLASSICAL[classical].renderer.split(":")  # imported at the first use
    renderer: Callable = getattr(import_module(module), function)
    return renderer


def check_inputs(image: np.ndarray, defocus: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Check a picture and its defocus map at the public API; both come back contiguous.

    Raises:
        ShapeError: Not (H, W, 3) and (H, W) of one size.
        ParameterError: NaN or infinity in either, numbers that are no floats, or light beyond all measure.
    """
    check_light("image", image)
    check_map("defocus", defocus)
    check_floats("defocus", defocus)
    check_same_size("image", image, "defocus", defocus)
    dtype = np.float64 if image.dtype == np.float64 else np.float32
    return np.ascontiguousarray(image, dtype), np.ascontiguousarray(defocus, dtype)


def check_focuses_alone(lens_response: LensResponse | None, engine: str) -> None:
    """Raise ``ParameterError`` for a lens that does more than focus and tilt, all that ``engine`` knows."""
    if lens_response is None:
        return
    upright = lens_response.aberration_map.without_tilt()
    if not replace(lens_response, aberration_map=upright).is_plain:
        expected = "one that knows aberrations, rims and fringes of a lens"
        raise ParameterError("engine", expected, engine, "use the engine `rays` or `hybrid`")

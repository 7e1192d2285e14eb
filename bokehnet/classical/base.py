"""Interface of the classical renderers: inputs, options, result, and lookup by name."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Protocol, TypedDict, Unpack

import numpy as np

from bokehnet.arrays.viewport import Viewport
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
    "MAX_RADIUS_IN_SIDES",
    "ClassicalOptions",
    "ClassicalRenderer",
    "ClassicalResult",
    "Strip",
    "check_ideal_except_tilt",
    "check_inputs",
    "make_classical",
    "with_halo",
]

# Strips begin at multiples of this many rows of the picture, the largest block of any renderer in pixels.
ALIGNED = 128

# Largest blur radius in units of the longer side, for all engines: beyond it a disc is larger than the
# picture around every pixel, and only time and memory grow.
MAX_RADIUS_IN_SIDES = 4.0


def with_halo(span: slice, halo: int, size: int) -> slice:
    """Return the rows or columns of a span and ``halo`` pixels on either side, of ``size``; aligned."""
    return slice(max(0, span.start - halo) // ALIGNED * ALIGNED, min(size, span.stop + halo))


@dataclass(frozen=True, kw_only=True, slots=True)
class Strip:
    """Position of arrays in a larger picture, and the part of them that is rendered.

    Attributes:
        first: Row of the picture at which the arrays begin; a multiple of ``ALIGNED``.
        last: Row of the picture behind the last row of the arrays.
        left: Column of the picture at which the arrays begin; a multiple of ``ALIGNED``.
        right: Column of the picture behind the last column of the arrays.
        height: Height of the whole picture, pixels.
        width: Width of the whole picture, pixels.
        max_coc_radius: Largest blur radius of the whole picture, rounded up to whole pixels.
        max_ray_reach: Maximum distance of rays from their pixel, pixels; at least ``max_coc_radius``.
        output_rows: Rows of the arrays that are rendered; the others are the halo.
        output_columns: Columns of the arrays that are rendered.
    """

    first: int
    last: int
    left: int
    right: int
    height: int
    width: int
    max_coc_radius: int
    max_ray_reach: int
    output_rows: slice
    output_columns: slice

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the whole picture, pixels."""
        return self.height, self.width

    @property
    def arrays(self) -> tuple[slice, slice]:
        """Rows and columns of the picture that the arrays contain."""
        return slice(self.first, self.last), slice(self.left, self.right)

    @property
    def output(self) -> tuple[slice, slice]:
        """Rows and columns of the arrays that are rendered."""
        return self.output_rows, self.output_columns

    def cropped(self, rows: slice, columns: slice) -> "Strip":
        """Return the position of some rows and columns of the arrays, which contain the output."""

        def moved(span: slice, start: int) -> slice:
            return slice(span.start - start, span.stop - start)

        return replace(
            self,
            first=self.first + rows.start,
            last=self.first + rows.stop,
            left=self.left + columns.start,
            right=self.left + columns.stop,
            output_rows=moved(self.output_rows, rows.start),
            output_columns=moved(self.output_columns, columns.start),
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class ClassicalResult:
    """Result of a classical renderer.

    Attributes:
        bokeh: Rendered picture, scene-linear, (H, W, 3).
        error_map: Expected error of the rendered picture, (H, W) in [0, 1]; 1 = trust a network.
        occluded_background: Estimated colors behind each pixel, scene-linear, (H, W, 3); ``None`` if the
            renderer estimates none.
        disocclusion_weight: Fraction of each pixel's light that comes from the occluded background or from
            beyond the border, (H, W) in [0, 1]; ``None`` if the renderer estimates neither.
        mixed_pixels: Pixels that were unmixed, with both surfaces; ``None`` if the renderer unmixes none.
        scatter: Picture rendered by the scatter, (H, W, 3); ``None`` if it was not rendered in addition.
    """

    bokeh: np.ndarray
    error_map: np.ndarray
    occluded_background: np.ndarray | None = None
    disocclusion_weight: np.ndarray | None = None
    mixed_pixels: KnownSurfaces | None = None
    scatter: np.ndarray | None = None

    def part(self, rows: slice, columns: slice) -> "ClassicalResult":
        """Return the result of some rows and columns, slices with both ends."""

        def cropped(array: np.ndarray | None) -> np.ndarray | None:
            return None if array is None else array[rows, columns]

        return ClassicalResult(
            bokeh=self.bokeh[rows, columns],
            error_map=self.error_map[rows, columns],
            occluded_background=cropped(self.occluded_background),
            disocclusion_weight=cropped(self.disocclusion_weight),
            mixed_pixels=self.mixed_pixels and self.mixed_pixels.part(rows, columns),
            scatter=cropped(self.scatter),
        )

    @property
    def features(self) -> np.ndarray | None:
        """Occluded background, disocclusion weight and error map as one array, (H, W, 5), for networks."""
        if self.occluded_background is None or self.disocclusion_weight is None:
            return None
        return np.dstack([self.occluded_background, self.disocclusion_weight, self.error_map])


class ClassicalOptions(TypedDict, total=False):
    """Options of a classical renderer, in addition to picture, defocus and aperture.

    Attributes:
        strip: Position of the arrays in a larger picture, and the part to render, which alone is returned;
            default: the arrays are the whole picture.
        lens_response: Aberrations, vignetting and dispersion of the lens; default: a perfect lens.
        viewport: Position in the shown picture of the whole picture, of which a strip may be a part; default:
            all of it is shown.
        progress: Callback that receives the completed fraction of the work, 0 to 1.
        pixel_filter: Pixel filter of the picture, which mixes both surfaces at edges.
        known: Known surfaces of pixels at edges, for renderers that use layers; they are not estimated.
        rays_factor: Factor on the number of rays per pixel, where several pixels are reduced to one.
        layers: True layers, for renderers that use layers.
    """

    strip: Strip | None
    lens_response: LensResponse | None
    viewport: Viewport | None
    progress: Callable[[float], None] | None
    pixel_filter: PixelFilter
    known: KnownSurfaces | None
    rays_factor: float
    layers: Layers | None


class ClassicalRenderer(Protocol):
    """Renderer without learned components."""

    def __call__(
        self,
        image: np.ndarray,
        defocus: np.ndarray,
        aperture: Aperture | None = None,
        **options: Unpack[ClassicalOptions],
    ) -> ClassicalResult:
        """Render bokeh.

        Args:
            image: All-in-focus picture, scene-linear, (H, W, 3), float32.
            defocus: Signed blur radius in pixels, (H, W), positive in front of focus.
            aperture: Shape of the aperture; default: a disc.
            options: See :class:`ClassicalOptions`.
        """
        ...


def make_classical(classical: str) -> ClassicalRenderer:
    """Return the classical renderer of this name; an unknown name raises ``ParameterError``."""
    check_choice("classical", classical, CLASSICAL)
    module, function = CLASSICAL[classical].renderer.split(":")  # imported at the first use
    renderer: Callable = getattr(import_module(module), function)
    return renderer


def check_inputs(image: np.ndarray, defocus: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Check a picture and its defocus map, and return both as contiguous arrays.

    Raises:
        ShapeError: The arrays are not (H, W, 3) and (H, W) of the same size.
        ParameterError: NaN or infinity in either, values that are not floats, or light beyond the limit.
    """
    check_light("image", image)
    check_map("defocus", defocus)
    check_floats("defocus", defocus)
    check_same_size("image", image, "defocus", defocus)
    dtype = np.float64 if image.dtype == np.float64 else np.float32
    return np.ascontiguousarray(image, dtype), np.ascontiguousarray(defocus, dtype)


def check_ideal_except_tilt(lens_response: LensResponse | None, engine: str) -> None:
    """Raise ``ParameterError`` unless the lens only focuses and tilts; ``engine`` supports nothing else."""
    if lens_response is None:
        return
    upright = lens_response.aberration_map.without_tilt()
    if not replace(lens_response, aberration_map=upright).is_ideal:
        expected = "one that supports aberrations, vignetting and color fringes of a lens"
        raise ParameterError("engine", expected, engine, "use the engine `rays` or `hybrid`")

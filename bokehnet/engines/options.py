"""Options of a render of arrays: optics, tone, known surfaces and memory in one object."""

from dataclasses import dataclass, fields, replace
from typing import Any

from bokehnet.arrays.viewport import Viewport
from bokehnet.checks import check_kind, check_number
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.deprecation import EARLIER_NAMES, warn_deprecated
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.pixels.pixel_filter import PixelFilter
from bokehnet.optics.tone import Highlights

__all__ = ["RenderOptions", "split_option_keywords", "with_option_keywords"]


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderOptions:
    """Options of :meth:`bokehnet.engines.engine.Engine.render` and :meth:`BokehRenderer.render_arrays`.

    Attributes:
        aperture: Shape of the aperture; default: that of the renderer, or a disc. The networks were trained
            on discs; with other shapes they correct the classical half.
        lens_response: Response of the lens; default: that of the renderer, or a perfect lens.
        viewport: Position of the pixels in the shown picture, whose centre is the optical axis; default:
            they are all of it.
        pixel_filter: Pixel filter of the picture, which mixes both surfaces at edges; default:
            Blackman-Harris of width 1.5, as in Blender.
        gamma: Weight of bright pixels where light mixes, 0.2 to 5; 1 is a real lens, above 1 emphasises
            them. See :func:`bokehnet.optics.tone.gamma_curve`.
        highlights: Restores the brightness of clipped lights before blurring. The result keeps
            it, unclipped; :meth:`Highlights.compress` restores the range of the photograph.
        known: Known surfaces of pixels at edges, which are not estimated; engines with one surface per
            pixel ignore them.
        layers: True layers, for engines that march rays, which replace those estimated from the
            picture; other engines ignore them.
        rays_factor: Factor on the number of rays per pixel, above 0 to 1, where several pixels are
            reduced to one.
        expected_error: True to estimate the error of the rays. With a hybrid it is that of its rays, too.
        max_memory: Maximum memory beyond image, defocus and result, bytes. Pictures that need
            more are rendered in strips; the result is the same except for rounding.
        memory_in_use: Part of ``max_memory`` that is already in use, bytes.
        overwrite: True if the result may replace image and defocus, which are invalid afterwards; in strips
            this saves their memory. Both must be float32, C-contiguous and writable, otherwise they stay
            unchanged.

    Raises:
        ParameterError: A field has the wrong type.

    Examples:
        >>> RenderOptions(gamma=2.2, max_memory=2_000_000_000).gamma
        2.2
    """

    aperture: Aperture | None = None
    lens_response: LensResponse | None = None
    viewport: Viewport | None = None
    pixel_filter: PixelFilter | None = None
    gamma: float = 1.0
    highlights: Highlights | None = None
    known: KnownSurfaces | None = None
    layers: Layers | None = None
    rays_factor: float = 1.0
    expected_error: bool = False
    max_memory: int | None = None
    memory_in_use: int = 0
    overwrite: bool = False

    def __post_init__(self) -> None:
        check_kind("aperture", self.aperture, Aperture, optional=True)
        check_kind("lens_response", self.lens_response, LensResponse, optional=True)
        check_kind("viewport", self.viewport, Viewport, optional=True)
        check_kind("pixel_filter", self.pixel_filter, PixelFilter, optional=True)
        check_kind("highlights", self.highlights, Highlights, optional=True)
        check_kind("known", self.known, KnownSurfaces, optional=True)
        check_kind("layers", self.layers, Layers, optional=True)
        if self.max_memory is not None:
            check_number("max_memory", self.max_memory)


def split_option_keywords(keywords: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the fields of :class:`RenderOptions` among ``keywords``, by their present names, and the rest.

    Examples:
        >>> split_option_keywords({"memory_taken": 5, "blur": 3})
        ({'memory_in_use': 5}, {'blur': 3})
    """
    present = {EARLIER_NAMES["RenderOptions"].get(name, name): value for name, value in keywords.items()}
    names = {field.name for field in fields(RenderOptions)}
    options = {name: value for name, value in present.items() if name in names}
    return options, {name: value for name, value in present.items() if name not in names}


def with_option_keywords(options: RenderOptions | None, keywords: dict[str, Any]) -> RenderOptions | None:
    """Return options with fields that a caller passed as keywords, deprecated since version 0.2.

    Raises:
        TypeError: A keyword is no field.
    """
    if not keywords:
        return options
    present, others = split_option_keywords(keywords)
    if others:
        raise TypeError(f"unexpected keyword arguments: {', '.join(others)}")
    names = ", ".join(f"{name}=..." for name in present)
    message = f"pass options=RenderOptions({names}) instead of keywords; version 0.3 removes them"
    warn_deprecated(message, level=2)
    return replace(options or RenderOptions(), **present)

"""Mixed pixels, which show two surfaces: known ones, and others by unmixing."""

import numpy as np

from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.boundaries.light_carriers import split_lights
from bokehnet.classical.layered.boundaries.pixel_boundaries import LEVELS
from bokehnet.classical.layered.boundaries.unmixing import KNOWN_MIXED, MixedPixels, unmix
from bokehnet.classical.layered.depth_discontinuities import (
    DISCONTINUITY_THRESHOLD,
    sharpen_discontinuities,
)
from bokehnet.classical.layered.slight_steps import SLIGHT, sides_with_slight_steps
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter

__all__ = ["find_mixed_pixels", "to_known_surfaces"]

# Upper bound of the coverage at a slight step: rays pass behind partial coverage, but see full coverage as a
# slope down to the occluded surface.
_MAX_SLIGHT_COVERAGE = np.float32(1 - 1 / LEVELS)


def find_mixed_pixels(
    image: np.ndarray,
    defocus: np.ndarray,
    lights: np.ndarray,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    known: KnownSurfaces | None = None,
) -> tuple[np.ndarray, MixedPixels]:
    """Find the mixed pixels of a picture, and its defocus with a step wherever a surface ends.

    Pixels at steps of less than ``DISCONTINUITY_THRESHOLD``
    (:mod:`bokehnet.classical.layered.slight_steps`) are included unless all surfaces are known.

    Known pixels whose surfaces are within ``DISCONTINUITY_THRESHOLD`` of each other are not mixed. The others
    have the depth of the surface that covers more of them, whatever ``defocus`` is, and are mixed unless that
    surface covers all; if their colors are unknown, the pixel filter may mix them like any others.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3), float32.
        defocus: Signed blur radius in pixels, (H, W), + in front of focus, float32.
        lights: Pixels that are not unmixed but assigned to their carrier, (H, W) bool. Known colors take
            precedence.
        pixel_filter: Pixel filter of the picture.
        known: Known surfaces, which are not estimated.

    Returns:
        Defocus (H, W), and the mixed pixels.
    """
    sharp, reach = sharpen_discontinuities(defocus), len(pixel_filter.weights()) // 2
    if known is None:
        return sharp, _unmix_all(image, sharp, sides_with_slight_steps(sharp, reach), lights, pixel_filter)
    mixed = known.select(known.near - known.far > DISCONTINUITY_THRESHOLD)
    own = np.where(mixed.coverage >= 0.5, mixed.near, mixed.far)
    sharp[mixed.rows, mixed.columns] = own
    mixed = mixed.select((mixed.coverage > 0) & (mixed.coverage < 1))
    sides = sides_with_slight_steps(sharp, reach)
    if known.complete:
        sides[:] = 0
    if mixed.front is None or mixed.back is None:
        sides[mixed.rows, mixed.columns] = KNOWN_MIXED
        return sharp, _unmix_all(image, sharp, sides, lights, pixel_filter, mixed)
    sides[known.rows, known.columns] = 0
    estimated = _unmix_all(image, sharp, sides, lights, pixel_filter)
    known_mixed = MixedPixels(
        rows=mixed.rows,
        columns=mixed.columns,
        front=mixed.front,
        back=mixed.back,
        near=mixed.near,
        far=mixed.far,
        coverage=mixed.coverage,
        is_front=mixed.coverage >= 0.5,
    )
    return sharp, _joined(estimated, known_mixed)


def _unmix_all(
    image: np.ndarray,
    sharp: np.ndarray,
    sides: np.ndarray,
    lights: np.ndarray,
    pixel_filter: PixelFilter,
    known_mixed: KnownSurfaces | None = None,
) -> MixedPixels:
    """Return the unmixed pixels, and the lights with their carriers."""
    mixed = unmix(image, sharp, sides, lights, pixel_filter, known_mixed)
    mixed.coverage[mixed.is_slight] = np.minimum(mixed.coverage[mixed.is_slight], _MAX_SLIGHT_COVERAGE)
    return _joined(mixed, split_lights(image, sharp, sides & ~(KNOWN_MIXED | SLIGHT), lights))


def _joined(first: MixedPixels, second: MixedPixels) -> MixedPixels:
    return MixedPixels(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def to_known_surfaces(mixed: MixedPixels) -> KnownSurfaces:
    """Return the mixed pixels in row order, as known surfaces."""
    order = np.lexsort((mixed.columns, mixed.rows))
    return KnownSurfaces(
        rows=mixed.rows[order],
        columns=mixed.columns[order],
        near=mixed.near[order],
        far=mixed.far[order],
        coverage=mixed.coverage[order],
        front=mixed.front[order],
        back=mixed.back[order],
    )

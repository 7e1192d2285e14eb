"""Which pixels show two surfaces, and what these are: as is known beforehand, else as unmixing finds."""

import numpy as np

from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.boundaries.light_carriers import part_lights
from bokehnet.classical.layered.boundaries.pixel_boundaries import LEVELS
from bokehnet.classical.layered.boundaries.unmixing import HELD, MixedPixels, unmix
from bokehnet.classical.layered.depth_discontinuities import (
    DISCONTINUITY_THRESHOLD,
    discontinuity_sides,
    sharpen_discontinuities,
)
from bokehnet.classical.layered.slight_steps import SLIGHT, sides_with_slight_steps
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter

__all__ = ["find_mixed_pixels", "told_of"]

# Most that is covered at a slight step: rays pass behind what covers a part, and would take what covers all
# for a slope down to what it hides.
_NEARLY_ALL = np.float32(1 - 1 / LEVELS)


def find_mixed_pixels(
    image: np.ndarray,
    defocus: np.ndarray,
    lights: np.ndarray,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
    known: KnownSurfaces | None = None,
) -> tuple[np.ndarray, MixedPixels]:
    """Find the mixed pixels of a picture, and its defocus with a step wherever one surface ends.

    Those at steps of less than ``DISCONTINUITY_THRESHOLD``
    (:mod:`bokehnet.classical.layered.slight_steps`) are among them where nothing is known.

    Known pixels whose surfaces are within ``DISCONTINUITY_THRESHOLD`` of each other are no mixture. The
    others have the depth of the surface that covers more of them, whatever ``defocus`` says, and are mixed
    where that does not cover all; where colours are not known, the pixel filter may mix them as any others.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3), float32.
        defocus: Signed blur radius in pixels, (H, W), + in front of focus, float32.
        lights: Pixels that are not unmixed but given to what carries them, (H, W) bool. Known colours are
            taken there too.
        pixel_filter: Of the picture.
        known: What need not be estimated.

    Returns:
        Defocus (H, W), and the mixed pixels.
    """
    sharp, reach = sharpen_discontinuities(defocus), len(pixel_filter.weights()) // 2
    if known is None:
        return sharp, _parted(image, sharp, sides_with_slight_steps(sharp, reach), lights, pixel_filter)
    parted = known.select(known.near - known.far > DISCONTINUITY_THRESHOLD)
    own = np.where(parted.coverage >= 0.5, parted.near, parted.far)
    sharp[parted.rows, parted.columns] = own
    parted = parted.select((parted.coverage > 0) & (parted.coverage < 1))
    sides = discontinuity_sides(sharp, reach)
    if known.complete:
        sides[:] = 0
    if parted.front is None or parted.back is None:
        sides[parted.rows, parted.columns] = HELD
        return sharp, _parted(image, sharp, sides, lights, pixel_filter, parted)
    sides[known.rows, known.columns] = 0
    found = _parted(image, sharp, sides, lights, pixel_filter)
    told = MixedPixels(
        rows=parted.rows,
        columns=parted.columns,
        front=parted.front,
        back=parted.back,
        near=parted.near,
        far=parted.far,
        coverage=parted.coverage,
        is_front=parted.coverage >= 0.5,
    )
    return sharp, _joined(found, told)


def _parted(
    image: np.ndarray,
    sharp: np.ndarray,
    sides: np.ndarray,
    lights: np.ndarray,
    pixel_filter: PixelFilter,
    held: KnownSurfaces | None = None,
) -> MixedPixels:
    """Pixels unmixed, and lights with their carriers."""
    found = unmix(image, sharp, sides, lights, pixel_filter, held)
    found.coverage[found.is_slight] = np.minimum(found.coverage[found.is_slight], _NEARLY_ALL)
    return _joined(found, part_lights(image, sharp, sides & ~(HELD | SLIGHT), lights))


def _joined(first: MixedPixels, second: MixedPixels) -> MixedPixels:
    return MixedPixels(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def told_of(mixed: MixedPixels) -> KnownSurfaces:
    """The same pixels row by row, to be told to others."""
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

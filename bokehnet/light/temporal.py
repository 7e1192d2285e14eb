"""Recovered light that is stable over the frames of a shot.

The light of a region is the mean of the estimates of the same region in all frames within reach, relative to
the exposure of each frame. It depends on these frames alone, so that a part of a shot has the light of the
entire shot.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bokehnet.light.bright_picture import Array, BrightPicture, Floats, Indices, Mask
from bokehnet.light.config import DEFAULT_CONFIG, LightConfig
from bokehnet.light.recovery import RecoveredLight, estimated_light, picture_of
from bokehnet.light.regions import light_regions

__all__ = ["REACH_FRAMES", "FrameLight", "measure_frame", "steady_light", "steady_sums"]

# Number of frames before and after a frame that its light depends on.
REACH_FRAMES = 24

# Maximum ratio of the areas of a region in successive frames.
_MAX_AREA_RATIO = 3.0

# Maximum motion of a region between frames: a length, pixels, and a fraction of its radius.
_MAX_MOTION_PX, _MAX_MOTION_RADII = 6.0, 1.0

# Cells that measure the exposure: number along the short side, minimum light, and the minimum number of them.
_CELLS, _MIN_CELL_LIGHT, _MIN_CELLS = 24, 1e-3, 12

# Mean deviation of the logarithmic change of the cells from its median, from which a frame begins a new shot.
_CUT_CHANGE = 0.5

# Minimum light of a region, relative to the clip level.
_MIN_LIGHT = 1e-3


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FrameLight:
    """Regions of a frame that hold clipped pixels.

    Attributes:
        centers: Centers of mass, row and column in pixels, (regions, 2).
        area: Number of pixels, (regions,).
        is_large: True for skies and windows, False for lamps, (regions,).
        stored: Logarithm of the sums of the stored light, relative to the clip level, (regions, 3).
        recovered: The same with recovered light.
        cells: Logarithm of the mean light of square cells; NaN where the light is clipped or dark.
    """

    centers: Floats
    area: Floats
    is_large: Mask
    stored: Floats
    recovered: Floats
    cells: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """Relation of a frame to the next or previous one of its shot.

    Attributes:
        number: Number of the other frame.
        regions: The region of the other frame that is each region; -1 for none.
        exposure: Logarithm of the ratio of the other exposure to that of the frame.
    """

    number: int
    regions: Indices
    exposure: float


def measure_frame(
    image: Array, nearness: Array | None, config: LightConfig = DEFAULT_CONFIG
) -> FrameLight | None:
    """Measure the regions of a frame; None if nothing in it is clipped light.

    Args:
        image: Scene-linear picture, (H, W, 3), decoded from display-referred values of 0 to 1.
        nearness: Map in which near is large, (H, W).
        config: Constants.
    """
    picture = picture_of(image, nearness, config)
    if picture is None:
        return None
    regions, recovered = light_regions(picture), estimated_light(picture)
    pixels = regions.pixels
    area = pixels.sums()
    lamp_radius = max(config.lamp_radius * picture.diagonal, config.lamp_radius_px)
    return FrameLight(
        centers=np.stack([pixels.sums(x) / area for x in (pixels.rows, pixels.columns)], -1),
        area=area,
        is_large=np.sqrt(area / np.pi) > lamp_radius,
        stored=np.log(np.maximum(regions.sums(image), _MIN_LIGHT)),
        recovered=np.log(np.maximum(regions.sums(recovered), _MIN_LIGHT)),
        cells=_cells(picture),
    )


def steady_sums(frames: Mapping[int, FrameLight | None], selected: Collection[int]) -> dict[int, Floats]:
    """Return the stable sums of light, relative to the clip level, of each region of frames, (regions, 3).

    Args:
        frames: Regions by number of frame: those within reach of the selected frames.
        selected: Numbers of the frames to return; those without clipped light are left out.

    Examples:
        >>> picture = np.full((90, 120, 3), 0.004, np.float32)
        >>> picture[40:45, 60:65] = 1
        >>> light = measure_frame(picture, None)
        >>> sums = steady_sums({1: light, 2: light}, [2])
        >>> bool(np.allclose(np.log(sums[2]), light.recovered))
        True
    """
    numbers = sorted(frames)
    steps: dict[int, dict[int, _Step]] = {number: {} for number in numbers}
    for number, following in pairwise(numbers):
        first, second = frames[number], frames[following]
        if first is None or second is None or following - number > REACH_FRAMES:
            continue
        exposure = _exposure_change(first, second)
        if exposure is not None:
            forth, back = _links(first, second)
            steps[number][1] = _Step(following, forth, exposure)
            steps[following][-1] = _Step(number, back, -exposure)
    return {
        number: _steady(number, frames, steps)
        for number in numbers
        if number in selected and frames[number] is not None
    }


def steady_light(
    image: Array,
    nearness: Array | None,
    sums: Floats,
    strength: float = 1.0,
    config: LightConfig = DEFAULT_CONFIG,
) -> RecoveredLight:
    """Return a frame with the recovered light of its shot.

    Args:
        image: Scene-linear picture, (H, W, 3), decoded from display-referred values of 0 to 1.
        nearness: Map in which near is large, (H, W).
        sums: Sums of light of its regions, (regions, 3); see :func:`steady_sums`.
        strength: Factor on the light above the stored one.
        config: Constants.
    """
    picture = picture_of(image, nearness, config)
    if picture is None or strength <= 0:
        return RecoveredLight(image=image)
    regions = light_regions(picture)
    if regions.pixels.count != len(sums):
        return RecoveredLight(image=image)
    result = regions.with_sums(image, estimated_light(picture), sums)
    return RecoveredLight.of(image, result, picture.level, strength)


def _cells(picture: BrightPicture) -> Floats:
    side = max(1, min(picture.lowest.shape) // _CELLS)
    height, width = (length // side * side for length in picture.lowest.shape)
    blocks = (side, max(1, side // 8))
    light = picture.lowest[:height, :width].reshape(height // side, side, width // side, side)
    light = light[:, :: blocks[1], :, :: blocks[1]]
    mean = light.mean((1, 3), dtype=np.float64)
    is_shown = (light.max((1, 3)) < picture.level) & (mean > _MIN_CELL_LIGHT)
    return np.where(is_shown, np.log(np.maximum(mean, _MIN_CELL_LIGHT)), np.nan)


def _exposure_change(first: FrameLight, second: FrameLight) -> float | None:
    """Return the logarithm of the ratio of the exposures of successive frames; None at a cut."""
    if first.cells.shape != second.cells.shape:
        return None
    change = second.cells - first.cells
    change = change[np.isfinite(change)]
    if len(change) < _MIN_CELLS:
        return 0.0
    exposure = float(np.median(change))
    return exposure if np.abs(change - exposure).mean() < _CUT_CHANGE else None


def _links(first: FrameLight, second: FrameLight) -> tuple[Indices, Indices]:
    """Return the same region in the other frame, -1 for none, for the regions of both frames."""
    if not len(first.area) or not len(second.area):
        return np.full(len(first.area), -1), np.full(len(second.area), -1)
    distance = np.linalg.norm(first.centers[:, None] - second.centers, axis=-1)
    ratio = first.area[:, None] / second.area
    reach = _MAX_MOTION_PX + _MAX_MOTION_RADII * np.sqrt(first.area / np.pi)[:, None]
    is_allowed = (distance <= reach) & (np.maximum(ratio, 1 / ratio) < _MAX_AREA_RATIO)
    distance = np.where(is_allowed, distance, np.inf)
    forth, back = distance.argmin(1), distance.argmin(0)
    is_mutual = (back[forth] == np.arange(len(forth))) & np.isfinite(distance.min(1))
    forth = np.where(is_mutual, forth, -1)
    back = np.full(len(back), -1)
    back[forth[is_mutual]] = np.flatnonzero(is_mutual)
    return forth, back


def _common_gain(frame: FrameLight) -> float | None:
    """Return the mean logarithmic gain of the skies and windows of a frame; None without any."""
    gain = (frame.recovered - frame.stored).mean(-1)
    chosen = frame.is_large & (gain > 0)
    return float(np.average(gain[chosen], weights=frame.area[chosen])) if chosen.any() else None


def _steady(
    number: int, frames: Mapping[int, FrameLight | None], steps: Mapping[int, Mapping[int, _Step]]
) -> Floats:
    own = frames[number]
    assert own is not None
    sums, weights = own.recovered.copy(), np.ones(len(own.area))
    common = _common_gain(own)
    has_gain = (own.recovered > own.stored).any(-1)
    for side in (1, -1):
        current, index, exposure = number, np.arange(len(own.area)), 0.0
        while (step := steps[current].get(side)) is not None:
            if abs(step.number - number) > REACH_FRAMES:
                break
            current, exposure = step.number, exposure + step.exposure
            index = np.where(index >= 0, step.regions[index], -1)
            other = frames[current]
            assert other is not None
            value = own.recovered.copy()
            linked = np.flatnonzero(index >= 0)
            gain = other.recovered[index[linked]] - other.stored[index[linked]] + own.stored[linked]
            value[linked] = np.where(own.is_large[linked, None], gain, other.recovered[index[linked]])
            known = index >= 0
            other_common = _common_gain(other)
            if common is not None and other_common is not None:
                shared = own.is_large & has_gain & ~known
                value[shared] += other_common - common
                known |= shared
            weight = known * (1 - (abs(current - number) / (REACH_FRAMES + 1)) ** 2)
            sums += weight[:, None] * (value - exposure)
            weights += weight
    return np.exp(sums / weights[:, None])

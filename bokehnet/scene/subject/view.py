"""Coarse copy of a picture and its map, with the cues that do not depend on a candidate."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.resample import resample
from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.arrays.square_windows import reduce_windows
from bokehnet.scene.subject.masks import label, median3

__all__ = ["SubjectSearch", "View", "display", "grown"]

Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

# Distance in coarse pixels over which a depth edge is seen from the outline of a candidate.
_OUTLINE_PX = 3

# Number of planes that are tried as ground.
_PLANES = 200


@dataclass(frozen=True, kw_only=True, slots=True)
class SubjectSearch:
    """Tuned numbers of the search, measured by ``python -m benchmarks.quality.subject``.

    Disparities are relative to the range of the map between its 1st and 99th percentile.

    Attributes:
        side: Longer side of the picture that is analysed, pixels.
        bands: Number of bands of disparity of the finest division; candidates are unions of neighbours.
        min_area: Minimum area of a candidate, relative to the picture.
        full_area: Area from which on a candidate gets no penalty for being small.
        large_area: Area above which a candidate counts as background.
        edge_step: Difference of disparity that counts as a depth edge.
        surface_step: Maximum difference of disparity between neighbouring pixels of one surface.
        max_range: Maximum extent of the sharp range on either side of the subject's median disparity.
        ground_tolerance: Maximum deviation of ground from a plane.
        min_certainty: Certainty below which the fallback replaces the subject.

    Examples:
        >>> ramp = np.tile(np.linspace(0, 1, 60, dtype=np.float32), (40, 1))
        >>> image = np.full((40, 60, 3), 0.5, np.float32)
        >>> find_subject(image, ramp, search=SubjectSearch(min_certainty=1)).is_fallback
        True
    """

    side: int = 144
    bands: int = 10
    min_area: float = 0.006
    full_area: float = 0.06
    large_area: float = 0.5
    edge_step: float = 0.05
    surface_step: float = 0.02
    max_range: float = 0.12
    ground_tolerance: float = 0.03
    min_certainty: float = 0.35


class View:
    """Coarse copy of picture and map, with the cues that do not depend on a candidate.

    Attributes:
        values: Disparity relative to the range of the map, about 0 to 1, (height, width).
        ground: Pixels on the ground.
        colors: Lightness and two opponent colours, (height, width, 3).
        detail: Mean gradient of the full picture in each coarse pixel.
        prior: Preference for the centre and the thirds, 0 to 1.
        rank: Share of the picture that is farther than each pixel.
        far: Least value around each pixel.
        near: Largest value around each pixel.
    """

    def __init__(self, image: Array, disparity: Array, search: SubjectSearch) -> None:
        self.search, self.full = search, disparity
        shrink = max(1.0, max(disparity.shape) / search.side)
        self.height, self.width = (max(round(side / shrink), 1) for side in disparity.shape)
        rows = ((np.arange(self.height) + 0.5) * disparity.shape[0] / self.height).astype(int)
        columns = ((np.arange(self.width) + 0.5) * disparity.shape[1] / self.width).astype(int)
        self.raw = disparity[rows][:, columns]
        low, high = np.percentile(self.raw, (1, 99))
        self.span = float(max(high - low, 1e-12))
        self.values: Array = median3((self.raw - np.float32(low)) / np.float32(self.span))
        shown = display(resample(np.asarray(image, np.float32), self.height, self.width, "area"))
        red, green, blue = np.moveaxis(shown, -1, 0)
        self.colors = np.stack([(red + green + blue) / 3, red - green, (red + green) / 2 - blue], -1)
        self.detail = detail_of(image, self.height, self.width)
        y, x = np.mgrid[0.5 : self.height, 0.5 : self.width]
        x, y = x / self.width, y / self.height
        self.prior = np.exp(-(((x - 0.5) / 0.24) ** 2) / 2 - ((y - 0.52) / 0.3) ** 2 / 2)
        for third in (1 / 3, 2 / 3):
            third_weight = np.exp(-(((x - third) / 0.13) ** 2) / 2 - ((y - 0.55) / 0.3) ** 2 / 2)
            self.prior = np.maximum(self.prior, 0.9 * third_weight)
        self.rank = np.searchsorted(np.sort(self.values, None), self.values) / self.values.size
        self.far, self.near = (
            reduce_windows(self.values, _OUTLINE_PX, end) for end in (np.minimum, np.maximum)
        )
        self.ground = ground_of(self.values, search)

    def scaled_boxes(
        self, boxes: Sequence[tuple[int, int, int, int]], size: tuple[int, ...]
    ) -> list[tuple[slice, slice]]:
        """Return boxes of the full picture as rows and columns of the coarse one."""
        down, across = self.height / size[0], self.width / size[1]
        return [
            (
                slice(round(y * down), max(round((y + height) * down), round(y * down) + 1)),
                slice(round(x * across), max(round((x + width) * across), round(x * across) + 1)),
            )
            for x, y, width, height in boxes
        ]


def display(image: Array) -> Array:
    """Return a picture for display in [0, 1] whose 99th percentile is at most white."""
    light = np.maximum(np.asarray(image, np.float32)[..., :3], 0)
    white = max(float(np.percentile(light[::4, ::4], 99)) if light.size else 1.0, 1.0)
    shown: Array = np.minimum(light / np.float32(white), 1) ** np.float32(1 / 2.2)
    return shown


def detail_of(image: Array, height: int, width: int) -> Array:
    """Return the mean absolute gradient of the square root of green in each coarse pixel."""

    def steps(rows: slice) -> Array:
        above = min(rows.start, 1)
        green = np.sqrt(np.clip(np.asarray(image[rows.start - above : rows.stop, :, 1], np.float32), 0, 1))
        steps = np.zeros_like(green)
        steps[:, 1:] = np.abs(np.diff(green, axis=1))
        steps[1:] += np.abs(np.diff(green, axis=0))
        return steps[above:]

    return resample(make_in_row_blocks(steps, image.shape[:2], np.float32), height, width, "area")


def ground_of(values: Array, search: SubjectSearch) -> Mask:
    """Return the pixels of a plane that runs out of the lower border; none where there is no such plane.

    Disparity of a plane is affine in pixels (perspective projection). The plane is found by random samples of
    three pixels (Fischler and Bolles, "Random sample consensus", 1981), with a fixed seed.
    """
    height, width = values.shape
    y, x = np.mgrid[0:height, 0:width]
    xs, ys = x / width - 0.5, y / height
    lower = y >= height // 2
    rng = np.random.default_rng(0)
    pool = np.flatnonzero(lower.ravel())
    flat, fx, fy = values.ravel(), xs.ravel(), ys.ravel()
    thinned = pool[:: max(1, pool.size // 2000)]
    nothing = np.zeros(values.shape, bool)
    if pool.size < 3:
        return nothing
    picks = np.stack([rng.choice(pool, 3, replace=False) for _ in range(_PLANES)])
    systems = np.stack([fx[picks], fy[picks], np.ones(picks.shape)], 2)
    valid = np.abs(np.linalg.det(systems)) >= 1e-3
    planes = np.linalg.solve(systems[valid], flat[picks[valid]][..., None])[..., 0]
    planes = planes[(planes[:, 1] >= 0.15) & (np.abs(planes[:, 0]) <= 0.5 * planes[:, 1])]
    if not len(planes):
        return nothing
    on_planes = planes @ np.stack([fx[thinned], fy[thinned], np.ones(thinned.size)])
    shares = (np.abs(flat[thinned] - on_planes) < search.ground_tolerance).mean(1)
    plane = planes[np.argmax(shares)]
    if shares.max() < 0.2:
        return nothing
    near_plane = np.abs(values - plane[0] * xs - plane[1] * ys - plane[2]) < search.ground_tolerance
    if near_plane[-max(height // 20, 1) :].mean() < 0.3:
        return nothing
    labels = label(near_plane)
    borders = np.unique(labels[-1][labels[-1] > 0])
    ground: Mask = np.isin(labels, borders) & near_plane
    return ground


def grown(view: View, mask: Mask) -> Mask:
    """Return the mask with the smoothly connected rest of its surface, without ground."""
    middle = float(np.median(view.values[mask]))
    allowed = (np.abs(view.values - middle) <= view.search.max_range) & ~view.ground
    allowed |= mask
    grown = mask.copy()
    step = view.search.surface_step
    for _ in range(max(view.height, view.width)):
        before = grown.sum()
        for axis in (0, 1):
            for towards in (1, -1):
                moved, values = np.roll(grown, towards, axis), np.roll(view.values, towards, axis)
                edge = [slice(None), slice(None)]
                edge[axis] = slice(0, 1) if towards == 1 else slice(-1, None)
                moved[tuple(edge)] = False
                grown |= moved & allowed & (np.abs(view.values - values) <= step)
        if grown.sum() == before:
            break
    return grown

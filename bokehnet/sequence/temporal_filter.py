"""Temporal filter of the maps of a shot: polynomials are fitted to each value along its pixel's motion.

The noise of a map differs in each frame, and edges jump between pixels; real structure remains, or changes
smoothly along the motion of the picture. A frame's map is a function of the frames within
:data:`REACH_FRAMES`, so that any part of a shot gets the same maps as the entire shot. A cubic is fitted to
the values along each trajectory; each degree, and the cubics of narrower windows, count as far as their
energy exceeds that of the noise. The noise is measured by fourth differences over time, which are zero for
constant velocity, constant acceleration and evenly rising acceleration: without noise such motion passes
unchanged, with noise the result of a level scene is the mean. Fewer than five frames cannot separate noise
from motion, and remain unchanged. Colours that change along a trajectory end it.

Source:
    Fan and Gijbels, "Local polynomial modelling and its applications", 1996, for the fits; von Neumann,
    "Distribution of the ratio of the mean square successive difference to the variance", Annals of
    Mathematical Statistics 1941, for noise from differences, here fourth ones; Breiman, "Better subset
    regression using the nonnegative garrote", Technometrics 1995, for the shrinkage. Trajectories follow
    Brailean et al., "Noise reduction filters for dynamic image sequences: a review", Proceedings of the IEEE
    1995. The hierarchy of windows is original to this package.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.box_mean import box_mean
from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.sequence.optical_flow import coarse_flow, full_flow, warp
from bokehnet.sequence.trajectory_kernels import COMPONENTS, fit_trajectories

__all__ = ["REACH_FRAMES", "FilteredFrame", "FrameWindow"]

Array = npt.NDArray[np.float32]

# Frames before and after a frame that determine its map.
REACH_FRAMES = 24

# Root mean squared difference of encoded light at which the weight falls to 1/e.
_COLOR_SIGMA = 0.06

# Energies, in units of the variance of the noise, below which a component is noise: the 99.7 % quantiles of
# chi squared with one and with four degrees of freedom.
_SIGNIFICANCE_1, _SIGNIFICANCE_4 = 9.0, 16.3

# Half width of the window over which noise and energies are averaged.
_POOLING_RADIUS_PX = 2

# Weight of the median noise of a frame, in fourth differences, against those around a pixel.
_PRIOR_DIFFERENCES = 3.0

# Fraction of the range of values from which neighbours belong to different surfaces.
_EDGE_FRACTION = 0.05

_TINY = np.float32(1e-30)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FilteredFrame:
    """Filtered map of a frame.

    Attributes:
        number: Number of the frame.
        original: Map of the frame, (H, W).
        values: Filtered map, (H, W), in the same unit.
        picture: Encoded light of the frame, (H, W, 3), 8 bits.
        span: Range of the maps within reach.
        neighbours: Numbers of the frames within reach, ascending.
    """

    number: int
    original: Array
    values: Array
    picture: npt.NDArray[np.uint8]
    span: float
    neighbours: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Entry:
    """Frame of the window: its number, its place in the arrays, the extremes of its map, and its picture."""

    number: int
    slot: int
    low: float
    high: float
    picture: npt.NDArray[np.uint8]


class FrameWindow:
    """Frames of one size within reach of each other, stored in files of a folder.

    A window of HD frames takes 600 MB of disk; what is in use stays in the page cache.

    Args:
        folder: Folder for the files.
        shape: Height and width of the frames, pixels.

    Examples:
        >>> window = FrameWindow(Path("."), (32, 32))
        >>> picture, level = np.full((32, 32, 3), 128, np.uint8), np.ones((32, 32), np.float32)
        >>> for t in range(3):
        ...     window.add(t, picture, np.float32(0.1 * t) * level)
        >>> [round(float(window.filtered(t).values[0, 0]), 4) for t in range(3)]  # evenly rising
        [0.0, 0.1, 0.2]
    """

    def __init__(self, folder: Path, shape: tuple[int, int]) -> None:
        self.shape = shape
        size = 2 * REACH_FRAMES + 1
        self._free = deque(range(size))
        self._entries: deque[_Entry] = deque()
        self._folder = folder
        self._values = self._store("values", (size, *shape), np.float32)
        self._similarity = self._store("similarity", (2, size, *shape), np.uint8)
        flow = coarse_flow(*(np.zeros((*shape, 3), np.float32),) * 2)
        self._flow = self._store("flow", (2, size, *flow.shape), np.float32)
        self._scale = 1
        while -(-max(shape) // self._scale) > max(flow.shape):
            self._scale *= 2

    def add(self, number: int, picture: npt.NDArray[np.uint8], values: Array) -> None:
        """Add the next frame; frames that are farther than twice the reach before it are dropped.

        Args:
            number: Number of the frame, above those before.
            picture: Encoded light of the frame, (H, W, 3), 8 bits.
            values: Map of the frame, (H, W), any unit.
        """
        while self._entries and self._entries[0].number < number - 2 * REACH_FRAMES:
            self._free.append(self._entries.popleft().slot)
        entry = _Entry(
            number=number,
            slot=self._free.popleft(),
            low=float(values.min()),
            high=float(values.max()),
            picture=picture,
        )
        self._values[entry.slot] = values
        if self._entries:
            self._link(self._entries[-1], entry)
        self._entries.append(entry)

    def filtered(self, number: int) -> FilteredFrame:
        """Return the filtered map of a frame, from all added frames within reach."""
        window = [entry for entry in self._entries if abs(entry.number - number) <= REACH_FRAMES]
        center = next(index for index, entry in enumerate(window) if entry.number == number)
        span = max(entry.high for entry in window) - min(entry.low for entry in window)
        components = np.empty((COMPONENTS, *self.shape), np.float32)
        fit_trajectories(
            self._values,
            self._similarity,
            self._flow,
            np.array([entry.slot for entry in window], np.int64),
            np.array([entry.number - number for entry in window], np.float64),
            center,
            float(self._scale),
            float(REACH_FRAMES),
            _EDGE_FRACTION * span,
            components,
        )
        original = self._values[window[center].slot].copy()
        return FilteredFrame(
            number=number,
            original=original,
            values=_combined(original, components),
            picture=window[center].picture,
            span=span,
            neighbours=tuple(entry.number for entry in window),
        )

    def values_of(self, number: int) -> Array:
        """Return the unfiltered map of an added frame."""
        slot = next(entry.slot for entry in self._entries if entry.number == number)
        return self._values[slot].copy()

    def close(self) -> None:
        """Delete the files."""
        for name in ("values", "similarity", "flow"):
            self._file(name).unlink(missing_ok=True)

    def _link(self, before: _Entry, after: _Entry) -> None:
        """Store motion and similarity of two successive frames in both directions."""
        first, second = (np.asarray(entry.picture / np.float32(255), np.float32) for entry in (before, after))
        for direction, slot, source, target in (
            (0, before.slot, first, second),
            (1, after.slot, second, first),
        ):
            flow = coarse_flow(source, target)
            self._flow[direction, slot] = flow
            self._similarity[direction, slot] = _similarity(source, target, full_flow(flow, self.shape))

    def _store(self, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[np.generic]:
        return np.asarray(np.memmap(self._file(name), dtype, "w+", shape=shape))

    def _file(self, name: str) -> Path:
        return self._folder / f"window_{name}.dat"


def _similarity(source: Array, target: Array, flow: Array) -> npt.NDArray[np.uint8]:
    """Return the similarity of colours along the motion, 255 if equal, 0 where it leaves the picture."""
    height, width = source.shape[:2]
    change = make_in_row_blocks(
        lambda rows: np.square(source[rows] - warp(target, flow[rows], rows.start)).mean(2),
        (height, width),
        np.float32,
    )
    x, y = np.arange(width) + flow[..., 0], np.arange(height)[:, None] + flow[..., 1]
    inside = (x >= -0.5) & (y >= -0.5) & (x <= width - 0.5) & (y <= height - 0.5)
    return np.rint(255 * np.exp(-box_mean(change, 1) / _COLOR_SIGMA**2) * inside).astype(np.uint8)


def _combined(original: Array, components: Array) -> Array:
    """Return the sum of the mean and of the other components, each shrunk by the noise in its energy."""
    squares, weights, mean = components[:3]
    measured = weights > 0
    median = float(np.median(squares[measured] / weights[measured])) if measured.any() else 0.0
    area = (2 * _POOLING_RADIUS_PX + 1) ** 2
    squares, weights = (area * box_mean(sums, _POOLING_RADIUS_PX) for sums in (squares, weights))
    noise = (squares + _PRIOR_DIFFERENCES * median) / (weights + _PRIOR_DIFFERENCES)
    result = original + mean
    for contribution, energy, significance in _components(components):
        pooled = np.maximum(box_mean(energy, _POOLING_RADIUS_PX), _TINY)
        result += np.maximum(1 - significance * noise / pooled, 0) * contribution
    return np.asarray(result, np.float32)


def _components(components: Array) -> Iterator[tuple[Array, Array, float]]:
    """Yield value, energy and significance of three degrees and of the cubics of narrower windows."""
    for index in range(3, COMPONENTS, 2):
        yield components[index], components[index + 1], _SIGNIFICANCE_1 if index < 9 else _SIGNIFICANCE_4

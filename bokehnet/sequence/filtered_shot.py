"""Temporally filtered maps of a shot, stored in a folder until the last frame is rendered."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.depth_repair.config import MIN_EDGE_HEIGHT
from bokehnet.depth_repair.filters import local_extremes
from bokehnet.depth_repair.stages.deblur import snap_soft_edges
from bokehnet.depth_repair.stages.sharpen import repair_soft_edges, soft_edge_fraction
from bokehnet.errors import ImageFileError
from bokehnet.io.atomic import write_text
from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.progress import Progress, ignore_progress
from bokehnet.sequence.temporal_filter import TemporalStatistics, accumulate, filtered_map

__all__ = ["FilteredShot"]

Array = npt.NDArray[np.float32]

# Sharpness of the edges is measured in every eighth frame; edges count as sharp up to this fraction of soft
# edge pixels.
_SHARPNESS_INTERVAL_FRAMES, _MAX_SOFT_FRACTION = 8, 0.3

# Distance from a depth edge within which a map follows the picture's colours.
_EDGE_RADIUS_PX = 2

_DONE_FILE = "steady.json"


@dataclass(frozen=True, kw_only=True, slots=True)
class _MapStatistics:
    """Value range and sharpness of the maps of a shot.

    Attributes:
        scale: Largest absolute value of the first map.
        span: Value range of all maps, in units of ``scale``.
        sharp: True if the edges of the maps are sharp.
    """

    scale: float
    span: float
    sharp: bool


class FilteredShot:
    """Maps of a shot, filtered along its motion (:mod:`bokehnet.sequence.temporal_filter`).

    During filtering the folder holds 23 bytes for each pixel of the shot, afterwards 4.

    Args:
        folder: Folder of the maps; created if absent.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def is_done(self) -> bool:
        """True if all maps are filtered."""
        return (self.folder / _DONE_FILE).exists()

    def filter(
        self, frames: Iterable[tuple[Array, Array] | None], count: int, progress: Progress | None = None
    ) -> None:
        """Read all frames once and store their filtered maps; does nothing if they exist.

        Args:
            frames: Frames in time order: scene-linear picture (H, W, 3) and map (H, W); None for an
                unreadable frame, which gets no map. A change of size starts another shot.
            count: Number of frames.
            progress: Called with (steps done, total steps).

        Raises:
            ImageFileError: The folder cannot be written.
        """
        if self.is_done:
            return
        report = progress or ignore_progress
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            statistics = self._accumulate_forward(frames, count, report)
            present = [index for index in range(count) if self._file("map", index).exists()]
            self._filter_backward(present, statistics, count, report)
            summary = {"frames": len(present), "sharp": statistics.sharp}
            write_text(self.folder / _DONE_FILE, json.dumps(summary))
        except OSError as error:
            reason = error.strerror or str(error)
            raise ImageFileError(f"{self.folder}: steady maps cannot be stored there: {reason}") from error

    def has(self, index: int) -> bool:
        """Return whether a frame has a map."""
        return self._file("map", index).exists()

    def read(self, index: int) -> Array:
        """Return the filtered map of a frame, (H, W), in the unit of the maps.

        Raises:
            ImageFileError: The map does not exist.
        """
        try:
            values: Array = np.load(self._file("map", index)).astype(np.float32)
        except (OSError, ValueError) as error:
            raise ImageFileError(
                f"{self._file('map', index)}: expected a map of the shot, found none; start again"
            ) from error
        return values

    def _accumulate_forward(
        self, frames: Iterable[tuple[Array, Array] | None], count: int, report: Progress
    ) -> _MapStatistics:
        """Store all maps and pictures with the statistics accumulated from the first frame on."""
        past, scale, low, high = None, 0.0, np.inf, -np.inf
        softness: list[float] = []
        for index, frame in enumerate(frames):
            for name in ("picture", "past", "map"):
                self._file(name, index).unlink(missing_ok=True)
            report(index, 2 * count)
            if frame is None:
                continue
            image, values = frame
            scale = scale or float(np.abs(values).max()) or 1.0
            values = values / np.float32(scale)
            low, high = min(low, float(values.min())), max(high, float(values.max()))
            if len(softness) <= index / _SHARPNESS_INTERVAL_FRAMES:
                softness.append(soft_edge_fraction(values, by_height=False))
            picture = np.round(255 * linear_to_srgb(np.clip(image, 0, 1))).astype(np.uint8)
            past = accumulate(values, _light(picture), _if_same_size(past, values))
            np.save(self._file("picture", index), picture)
            np.save(self._file("past", index), past.moments)
            np.save(self._file("map", index), values.astype(np.float32))
        sharp = bool(softness) and float(np.median(softness)) <= _MAX_SOFT_FRACTION
        return _MapStatistics(scale=scale, span=max(0.0, high - low), sharp=sharp)

    def _filter_backward(
        self, indices: list[int], statistics: _MapStatistics, count: int, report: Progress
    ) -> None:
        """Replace the maps by the filtered ones, from the last frame back to the first."""
        future = None
        for index in reversed(indices):
            picture = _light(np.load(self._file("picture", index)))
            future = accumulate(np.load(self._file("map", index)), picture, _if_same_size(future, picture))
            past = TemporalStatistics(
                moments=np.load(self._file("past", index)), values=future.values, picture=picture
            )
            filtered = filtered_map(past, future)
            if statistics.sharp:
                filtered = _sharpened(filtered, picture, statistics.span)
            np.save(self._file("map", index), np.float32(statistics.scale) * filtered)
            for name in ("picture", "past"):
                self._file(name, index).unlink()
            report(2 * count - index, 2 * count)

    def _file(self, name: str, index: int) -> Path:
        return self.folder / f"{name}_{index:06d}.npy"


def _if_same_size(before: TemporalStatistics | None, values: Array) -> TemporalStatistics | None:
    """Return the statistics of the neighbour, or None if the size has changed."""
    return before if before is not None and before.values.shape == values.shape[:2] else None


def _sharpened(filtered: Array, picture: Array, span: float) -> Array:
    """Return the map with edges, softened by averaging, snapped to the picture's colour edges."""
    sharp = repair_soft_edges(filtered, span)
    low, high = local_extremes(sharp, _EDGE_RADIUS_PX)
    light = np.asarray(srgb_to_linear(picture), np.float32)
    return np.asarray(snap_soft_edges(light, sharp, high - low > MIN_EDGE_HEIGHT * span, span), np.float32)


def _light(picture: npt.NDArray[np.uint8]) -> Array:
    return np.asarray(picture / np.float32(255), np.float32)

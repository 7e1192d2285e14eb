"""Temporally filtered maps of a shot, stored in a folder until the last frame is rendered."""

import json
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.depth_repair.config import MIN_EDGE_HEIGHT
from bokehnet.depth_repair.filters import local_extremes
from bokehnet.depth_repair.stages.deblur import snap_soft_edges
from bokehnet.depth_repair.stages.sharpen import repair_soft_edges, soft_edge_fraction
from bokehnet.errors import BokehnetError, ImageFileError
from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.io.files.atomic import write_text
from bokehnet.progress import Progress, ignore_progress
from bokehnet.sequence.temporal_filter import REACH_FRAMES, FilteredFrame, FrameWindow

__all__ = ["FilteredShot", "MapRemarks"]

Array = npt.NDArray[np.float32]

# Assumptions about a map, and notes on it.
MapRemarks = tuple[tuple[str, ...], tuple[str, ...]]

# Sharpness of the edges is measured in frames whose number is a multiple of this; edges count as sharp up to
# this fraction of soft edge pixels.
_SHARPNESS_INTERVAL_FRAMES, _MAX_SOFT_FRACTION = 8, 0.3

# Distance from a depth edge within which a map follows the picture's colours.
_EDGE_RADIUS_PX = 2

# Change of a value, as a fraction of the range, from which the filter may have softened an edge.
_MIN_CHANGE = 0.01

_DONE_FILE = "steady.json"


class FilteredShot:
    """Maps of a shot, filtered along its motion (:mod:`bokehnet.sequence.temporal_filter`).

    The map of a frame depends on the frames within the reach of the filter alone, so that a part of a shot
    has the maps of the entire shot if the frames around it are read too. During filtering the folder holds
    6 bytes for each pixel of 49 frames, and afterwards 4 for each pixel of the shot.

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
        self,
        frames: Iterable[tuple[Array, Array] | None],
        numbers: Sequence[int],
        progress: Progress | None = None,
        *,
        selected: Collection[int] | None = None,
        remarks: Mapping[int, MapRemarks] | None = None,
    ) -> None:
        """Read all frames once and store their filtered maps; does nothing if they exist.

        Args:
            frames: Frames in time order: scene-linear picture (H, W, 3) and map (H, W); None for an
                unreadable frame, which gets no map. A change of size starts another shot.
            numbers: Number of each frame, ascending; differences are distances in time.
            progress: Called with (steps done, total steps).
            selected: Numbers of the frames that get a map. Default: all.
            remarks: Remarks on the unfiltered map of each frame, by number; read after the last frame.

        Raises:
            BokehnetError: The folder cannot be written, or reading the frames fails.
        """
        if self.is_done:
            return
        chosen = set(numbers if selected is None else selected)
        report = progress or ignore_progress
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for number in chosen:
                self._file(number).unlink(missing_ok=True)
            count = 0
            for done, filtered in self._filtered(frames, numbers, chosen):
                report(done, len(numbers))
                if filtered is not None:
                    np.save(self._file(filtered.number), filtered.values)
                    count += 1
            report(len(numbers), len(numbers))
            kept = {number: remarks[number] for number in chosen if remarks and number in remarks}
            write_text(self.folder / _DONE_FILE, json.dumps({"frames": count, "remarks": kept}))
        except BokehnetError:  # some are also OSError
            raise
        except OSError as error:
            reason = error.strerror or str(error)
            raise ImageFileError(f"{self.folder}: steady maps cannot be stored there: {reason}") from error

    def has(self, number: int) -> bool:
        """Return whether a frame has a map."""
        return self._file(number).exists()

    def read(self, number: int) -> Array:
        """Return the filtered map of a frame, (H, W), in the unit of the maps.

        Raises:
            ImageFileError: The map does not exist.
        """
        try:
            values: Array = np.load(self._file(number)).astype(np.float32)
        except (OSError, ValueError) as error:
            raise ImageFileError(
                f"{self._file(number)}: expected a map of the shot, found none; start again"
            ) from error
        return values

    def remarks(self, number: int) -> MapRemarks:
        """Return the remarks on the unfiltered map of a frame."""
        table = json.loads((self.folder / _DONE_FILE).read_text(encoding="utf-8"))
        assumptions, notes = table.get("remarks", {}).get(str(number), ((), ()))
        return tuple(assumptions), tuple(notes)

    def _filtered(
        self, frames: Iterable[tuple[Array, Array] | None], numbers: Sequence[int], chosen: Collection[int]
    ) -> Iterator[tuple[int, FilteredFrame | None]]:
        """Yield the number of frames read, and each filtered frame once all frames within reach are read."""
        window: FrameWindow | None = None
        pending: list[int] = []
        softness: dict[int, float] = {}

        def finished(before: float) -> Iterator[FilteredFrame]:
            while window is not None and pending and pending[0] + REACH_FRAMES < before:
                yield _sharpened(window, pending.pop(0), softness)

        try:
            for done, (number, frame) in enumerate(zip(numbers, frames, strict=True)):
                yield done, None
                if frame is None:
                    continue
                image, values = frame
                changed = window is not None and window.shape != values.shape
                for filtered in finished(math.inf if changed else number):
                    yield done, filtered
                if window is None or changed:
                    if window is not None:
                        window.close()
                    window, softness = FrameWindow(self.folder, values.shape), {}
                picture = np.round(255 * linear_to_srgb(np.clip(image, 0, 1))).astype(np.uint8)
                window.add(number, picture, values)
                if number in chosen:
                    pending.append(number)
            for filtered in finished(math.inf):
                yield len(numbers), filtered
        finally:
            if window is not None:
                window.close()

    def _file(self, number: int) -> Path:
        return self.folder / f"map_{number:06d}.npy"


def _sharpened(window: FrameWindow, number: int, softness: dict[int, float]) -> FilteredFrame:
    """Return a filtered map whose edges, where averaging has softened them, are sharp again.

    Edges snap to those of the picture if the edges of the unfiltered maps within reach are sharp.

    Args:
        window: Frames within reach.
        number: Number of the frame.
        softness: Fractions of soft edge pixels by frame, filled on demand.
    """
    filtered = window.filtered(number)
    probes = [n for n in filtered.neighbours if n % _SHARPNESS_INTERVAL_FRAMES == 0]
    for probe in probes or filtered.neighbours[:1]:
        if probe not in softness:
            softness[probe] = soft_edge_fraction(window.values_of(probe), by_height=False)
    is_sharp = np.median([softness[n] for n in probes or filtered.neighbours[:1]]) <= _MAX_SOFT_FRACTION
    span, values = filtered.span, filtered.values
    change = np.abs(values - filtered.original)
    if not is_sharp or change.max() <= _MIN_CHANGE * span:
        return filtered
    sharp = repair_soft_edges(values, span)
    low, high = local_extremes(sharp, _EDGE_RADIUS_PX)
    light = np.asarray(srgb_to_linear(filtered.picture / np.float32(255)), np.float32)
    sharp = snap_soft_edges(light, sharp, high - low > MIN_EDGE_HEIGHT * span, span)
    softened = local_extremes(change, _EDGE_RADIUS_PX)[1] > _MIN_CHANGE * span
    return replace(filtered, values=np.where(softened, sharp, values).astype(np.float32))

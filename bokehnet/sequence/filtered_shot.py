"""The steady maps of a whole shot, kept in a folder from the first pass to the last picture."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.depth_repair.stages.edge_sharpening import STEP, extremes, repair_soft_edges, soft_edge_fraction
from bokehnet.depth_repair.stages.weighted_median import settle_soft_steps
from bokehnet.errors import ImageFileError
from bokehnet.io.atomic import write_text
from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.progress import Progress
from bokehnet.sequence.temporal_filter import Gathered, gather, joined

__all__ = ["SteadyShot"]

Array = npt.NDArray[np.float32]

# Frames of which one is looked at for whether the maps' edges are sharp, and the share of soft steps up to
# which they are.
_LOOK, _SHARP = 8, 0.3

# Pixels from a step within which a map follows the picture's colours.
_NEAR = 2

_DONE = "steady.json"


@dataclass(frozen=True, kw_only=True, slots=True)
class _Values:
    """What the maps of a shot hold.

    Attributes:
        scale: Largest value of the first one.
        span: Of all of them over it.
        sharp: Whether their edges are.
    """

    scale: float
    span: float
    sharp: bool


class SteadyShot:
    """Maps of a shot, made steady along its motion (:mod:`bokehnet.sequence.temporal_filter`).

    While it is made, the folder holds 23 bytes for each pixel of the shot, afterwards 4.

    Args:
        folder: Where they are kept; made if it is not there.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def is_done(self) -> bool:
        """Whether all maps are there."""
        return (self.folder / _DONE).exists()

    def make(
        self, frames: Iterable[tuple[Array, Array] | None], count: int, progress: Progress | None = None
    ) -> None:
        """Read all frames once and keep their steady maps; what has been made stays as it is.

        Args:
            frames: In the order of time: scene-linear picture (H, W, 3) and map (H, W). None for one that
                cannot be read, which gets no map. Where the size changes another shot begins.
            count: How many there are.
            progress: Called with (steps done, steps in all).

        Raises:
            ImageFileError: The folder cannot be written.
        """
        if self.is_done:
            return
        report = progress or _untold
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            values = self._look(frames, count, report)
            found = [index for index in range(count) if self._file("map", index).exists()]
            self._settle(found, values, count, report)
            write_text(self.folder / _DONE, json.dumps({"frames": len(found), "sharp": values.sharp}))
        except OSError as error:
            reason = error.strerror or str(error)
            raise ImageFileError(f"{self.folder}: steady maps cannot be kept there: {reason}") from error

    def has(self, index: int) -> bool:
        """Whether a frame has a map."""
        return self._file("map", index).exists()

    def read(self, index: int) -> Array:
        """Return the steady map of a frame, (H, W), in the unit of the maps.

        Raises:
            ImageFileError: It is not there.
        """
        try:
            values: Array = np.load(self._file("map", index)).astype(np.float32)
        except (OSError, ValueError) as error:
            raise ImageFileError(
                f"{self._file('map', index)}: expected a map of the shot, found none; start again"
            ) from error
        return values

    def _look(self, frames: Iterable[tuple[Array, Array] | None], count: int, report: Progress) -> _Values:
        """Keep all maps and pictures with what is gathered from the first frame on."""
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
            if len(softness) <= index / _LOOK:
                softness.append(soft_edge_fraction(values, by_size=False))
            picture = np.round(255 * linear_to_srgb(np.clip(image, 0, 1))).astype(np.uint8)
            past = gather(values, _light(picture), _of_size(past, values))
            np.save(self._file("picture", index), picture)
            np.save(self._file("past", index), past.told)
            np.save(self._file("map", index), values.astype(np.float32))
        sharp = bool(softness) and float(np.median(softness)) <= _SHARP
        return _Values(scale=scale, span=max(0.0, high - low), sharp=sharp)

    def _settle(self, found: list[int], shot: _Values, count: int, report: Progress) -> None:
        """Put the fitted maps in place of the maps, from the last frame back to the first."""
        future = None
        for index in reversed(found):
            picture = _light(np.load(self._file("picture", index)))
            future = gather(np.load(self._file("map", index)), picture, _of_size(future, picture))
            past = Gathered(told=np.load(self._file("past", index)), values=future.values, picture=picture)
            steady = joined(past, future)
            if shot.sharp:
                steady = _sharpened(steady, picture, shot.span)
            np.save(self._file("map", index), np.float32(shot.scale) * steady)
            for name in ("picture", "past"):
                self._file(name, index).unlink()
            report(2 * count - index, 2 * count)

    def _file(self, name: str, index: int) -> Path:
        return self.folder / f"{name}_{index:06d}.npy"


def _of_size(before: Gathered | None, values: Array) -> Gathered | None:
    """What was gathered, unless the size has changed since."""
    return before if before is not None and before.values.shape == values.shape[:2] else None


def _sharpened(steady: Array, picture: Array, span: float) -> Array:
    """A map whose edges, the mean of many, are sharp again, where the picture's colours part."""
    sharp = repair_soft_edges(steady, span)
    low, high = extremes(sharp, _NEAR)
    light = np.asarray(srgb_to_linear(picture), np.float32)
    return np.asarray(settle_soft_steps(light, sharp, high - low > STEP * span, span), np.float32)


def _light(picture: npt.NDArray[np.uint8]) -> Array:
    return np.asarray(picture / np.float32(255), np.float32)


def _untold(done: int, total: int) -> None:
    """Progress that nobody follows."""

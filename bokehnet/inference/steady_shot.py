"""The steady maps of a whole shot, kept in a folder from the first pass to the last picture."""

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.inference.alike_median import settle_soft_steps
from bokehnet.inference.disparity_edges import STEP, extremes, repair_soft_edges, soft_edge_fraction
from bokehnet.inference.steady_maps import Gathered, gather, joined
from bokehnet.io.atomic import write_text
from bokehnet.io.color import linear_to_srgb, srgb_to_linear
from bokehnet.io.row_blocks import Progress

__all__ = ["SteadyShot"]

Array = npt.NDArray[np.float32]

# Frames of which one is looked at for whether the maps' edges are sharp, and the share of soft steps up to
# which they are.
_LOOK, _SHARP = 8, 0.3

# Pixels from a step within which a map follows the picture's colours.
_NEAR = 2

_DONE = "steady.json"


class SteadyShot:
    """Maps of a shot, made steady along its motion (:mod:`bokehnet.inference.steady_maps`).

    While it is made, the folder holds 21 bytes for each pixel of the shot, afterwards 4.

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
        self, frames: Iterable[tuple[Array, Array]], count: int, progress: Progress | None = None
    ) -> None:
        """Read all frames once and keep their steady maps; what has been made stays as it is.

        Args:
            frames: In the order of time: scene-linear picture (H, W, 3) and map (H, W), all of one size.
            count: How many there are.
            progress: Called with (steps done, steps in all).
        """
        if self.is_done:
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        past, scale, softness, found = None, 0.0, [], 0
        for index, (image, values) in enumerate(frames):
            scale = scale or float(np.abs(values).max()) or 1.0
            if index % _LOOK == 0:
                softness.append(soft_edge_fraction(values))
            picture = np.round(255 * linear_to_srgb(np.clip(image, 0, 1))).astype(np.uint8)
            past = gather(values / np.float32(scale), _light(picture), past)
            np.save(self._file("picture", index), picture)
            np.save(self._file("past", index), _packed(past.sums, values / np.float32(scale)))
            np.save(self._file("map", index), values.astype(np.float32))
            found = index + 1
            if progress is not None:
                progress(found, 2 * count)
        sharp = float(np.median(softness)) <= _SHARP
        future = None
        for index in range(found - 1, -1, -1):
            values, picture = np.load(self._file("map", index)), _light(np.load(self._file("picture", index)))
            values = values / np.float32(scale)
            future = gather(values, picture, future)
            past = Gathered(sums=_unpacked(np.load(self._file("past", index)), values), picture=picture)
            steady = joined(past, future, values)
            np.save(self._file("map", index), scale * (_sharpened(steady, picture) if sharp else steady))
            for name in ("picture", "past"):
                self._file(name, index).unlink()
            if progress is not None:
                progress(2 * found - index, 2 * found)
        write_text(self.folder / _DONE, json.dumps({"frames": found, "sharp": sharp}))

    def read(self, index: int) -> Array:
        """Return the steady map of a frame, (H, W), in the unit of the maps."""
        values: Array = np.load(self._file("map", index)).astype(np.float32)
        return values

    def _file(self, name: str, index: int) -> Path:
        return self.folder / f"{name}_{index:06d}.npy"


def _sharpened(steady: Array, picture: Array) -> Array:
    """A map whose edges, the mean of many, are sharp again, where the picture's colours part."""
    sharp, least = repair_soft_edges(steady), STEP * float(np.ptp(steady))
    low, high = extremes(sharp, _NEAR)
    light = np.asarray(srgb_to_linear(picture), np.float32)
    return np.asarray(settle_soft_steps(light, sharp, high - low > least, float(np.ptp(steady))), np.float32)


def _light(picture: npt.NDArray[np.uint8]) -> Array:
    return np.asarray(picture / np.float32(255), np.float32)


def _packed(sums: Array, values: Array) -> npt.NDArray[np.float16]:
    """Sums as half floats: means, those of values as differences from a frame's own."""
    w, wt, wtt, wv, wtv = np.moveaxis(sums, 2, 0)
    return np.stack([w, wt / w, wtt / w, wv / w - values, (wtv - values * wt) / w], 2).astype(np.float16)


def _unpacked(packed: npt.NDArray[np.float16], values: Array) -> Array:
    w, t, tt, v, tv = np.moveaxis(packed.astype(np.float32), 2, 0)
    return np.stack([w, w * t, w * tt, w * (v + values), w * (tv + values * t)], 2)

"""Examples drawn from whole scenes: for networks that repair maps, and need no picture with bokeh."""

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from bokehnet.errors import DataFileError
from bokehnet.synth.shards import ShardSet, TrainingSample
from train.examples import Examples, Skips

__all__ = ["HeldOut", "ScenePairs"]

# Seed of held-out examples, and the side of their crops: whole pictures, or nearly so.
_SEED, HELD_OUT_CROP = 5, 256


class ScenePairs:
    """Draws a scene of one of several sets, each as likely as the others, and an example of it.

    Scenes are kept in memory once they are read. Damaged ones are named, counted and left out.

    Args:
        folders: Shards of ``bokehnet synth``.
        take: What an example needs of a scene.
        make: Makes an example of that, as arrays by name; takes also ``rng``.

    Raises:
        DataFileError: No shards are there, or nothing of them can be read.
    """

    def __init__(
        self,
        folders: Sequence[str],
        take: Callable[[TrainingSample], tuple[np.ndarray, ...]],
        make: Callable[..., dict[str, np.ndarray]],
    ) -> None:
        self._take, self._make = take, make
        self._skips = Skips()
        self.sets = [ShardSet(Path(folder), on_damage=self._skips) for folder in folders]
        self._seen: dict[tuple[int, int], tuple[np.ndarray, ...] | None] = {}

    def draw(self, rng: np.random.Generator) -> dict[str, Tensor]:
        """Draw one example."""
        arrays = None
        while arrays is None:
            arrays = self._scene(rng)
        return {name: torch.from_numpy(x) for name, x in self._make(*arrays, rng=rng).items()}

    def _scene(self, rng: np.random.Generator) -> tuple[np.ndarray, ...] | None:
        """Arrays of a scene, or ``None`` if it is damaged."""
        chosen = int(rng.integers(len(self.sets)))
        number = chosen, int(rng.integers(len(self.sets[chosen])))
        if number not in self._seen:
            try:
                sample = self.sets[chosen][number[1]]
            except DataFileError as error:
                self._seen[number] = None
                self._skips(error)
                if len(self._seen) == sum(map(len, self.sets)) and not any(self._seen.values()):
                    raise
                return None
            self._seen[number] = self._take(sample)
        return self._seen[number]


class HeldOut:
    """Held-out examples, once augmented and once clean; drawn when they are first needed.

    Args:
        source_of: Makes the source of a share of clean examples, and a side of the crops in pixels.
        count: Examples of each kind.
    """

    def __init__(self, source_of: Callable[[float, int], ScenePairs], count: int) -> None:
        self._sources = {
            kind: source_of(clean, HELD_OUT_CROP) for kind, clean in (("augmented", 0.0), ("clean", 1.0))
        }
        self._count = count

    @cached_property
    def examples(self) -> dict[str, list[dict[str, Tensor]]]:
        """Examples by kind."""
        found = {}
        for kind, source in self._sources.items():
            sequence = Examples(source, seed=_SEED, length=self._count)
            found[kind] = [sequence[i] for i in range(self._count)]
        return found

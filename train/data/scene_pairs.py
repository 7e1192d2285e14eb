"""Examples drawn from whole scenes, for networks that repair maps and need no picture with bokeh."""

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from bokehnet.errors import DataFileError
from bokehnet.synth.shards import ShardSet, TrainingSample
from train.data.examples import Examples, Skips

__all__ = ["HeldOut", "ScenePairs"]

# Seed of held-out examples, and the side of their crops in pixels: nearly whole pictures.
_HELD_OUT_SEED, HELD_OUT_CROP = 5, 256


class ScenePairs:
    """Source that draws a scene from one of several equally likely sets, and an example of it.

    Caches scenes in memory. Reports, counts and skips damaged ones.

    Args:
        folders: Shards of ``bokehnet synth``.
        take: Function that returns the arrays of a scene that an example needs.
        make: Function that makes an example, arrays by name, from those arrays and ``rng``.

    Raises:
        DataFileError: A folder holds no shards, or no scene is readable.
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
        self._cache: dict[tuple[int, int], tuple[np.ndarray, ...] | None] = {}

    def draw(self, rng: np.random.Generator) -> dict[str, Tensor]:
        """Draw one example."""
        arrays = None
        while arrays is None:
            arrays = self._scene(rng)
        return {name: torch.from_numpy(x) for name, x in self._make(*arrays, rng=rng).items()}

    def _scene(self, rng: np.random.Generator) -> tuple[np.ndarray, ...] | None:
        """Return the arrays of a random scene, or ``None`` if it is damaged."""
        set_index = int(rng.integers(len(self.sets)))
        key = set_index, int(rng.integers(len(self.sets[set_index])))
        if key not in self._cache:
            try:
                sample = self.sets[set_index][key[1]]
            except DataFileError as error:
                self._cache[key] = None
                self._skips(error)
                if len(self._cache) == sum(map(len, self.sets)) and not any(self._cache.values()):
                    raise
                return None
            self._cache[key] = self._take(sample)
        return self._cache[key]


class HeldOut:
    """Held-out examples, augmented and clean, drawn on first use.

    Args:
        source_of: Function of the fraction of clean examples and the side of the crops in pixels; returns a
            source.
        count: Number of examples of each kind.
    """

    def __init__(self, source_of: Callable[[float, int], ScenePairs], count: int) -> None:
        self._sources = {
            kind: source_of(clean, HELD_OUT_CROP) for kind, clean in (("augmented", 0.0), ("clean", 1.0))
        }
        self._count = count

    @cached_property
    def examples(self) -> dict[str, list[dict[str, Tensor]]]:
        """Lists of examples by kind, ``augmented`` and ``clean``."""
        examples = {}
        for kind, source in self._sources.items():
            sequence = Examples(source, seed=_HELD_OUT_SEED, length=self._count)
            examples[kind] = [sequence[i] for i in range(self._count)]
        return examples

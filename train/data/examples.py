"""Training examples as an endless, reproducible sequence, and their batches, for every network."""

import sys
from typing import Any, Protocol

import numpy as np
from torch import Tensor
from torch.utils.data import DataLoader, Dataset
from tqdm import tqdm

__all__ = ["Batches", "Examples", "Skips", "Source", "example_loader"]


class Source(Protocol):
    """Source of examples; must be picklable for loader processes."""

    def draw(self, rng: np.random.Generator) -> dict[str, Tensor]:
        """Draw one example; ``rng`` alone determines it."""


class Batches(Protocol):
    """Fields that every data configuration has."""

    @property
    def batch_size(self) -> int:
        """Examples per step."""

    @property
    def workers(self) -> int:
        """Loader processes; 0 loads in the training process."""


class Examples(Dataset):
    """Endless, reproducible sequence of examples: (seed, index) determines each one."""

    def __init__(self, source: Source, *, seed: int, length: int) -> None:
        self.source, self.seed, self.length = source, seed, length

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        return self.source.draw(np.random.default_rng([self.seed, index]))


def example_loader(
    source: Source, data: Batches, *, seed: int, steps: int, first_step: int = 0
) -> DataLoader[Any]:
    """Return a loader of batches ``first_step`` to ``steps``; a resumed run sees the same batches."""
    examples = Examples(source, seed=seed, length=steps * data.batch_size)
    return DataLoader(
        examples,
        batch_size=data.batch_size,
        sampler=range(first_step * data.batch_size, len(examples)),
        num_workers=data.workers,
        multiprocessing_context="spawn" if data.workers else None,
        prefetch_factor=4 if data.workers else None,
    )


class Skips:
    """Report each damaged item that is skipped, once, with a count per loader process."""

    def __init__(self) -> None:
        self._reported: set[str] = set()

    @property
    def count(self) -> int:
        """Number of skipped items."""
        return len(self._reported)

    def __call__(self, error: Exception) -> None:
        """Report the damaged item that ``error`` names."""
        text = " ".join(str(error).split())
        if text not in self._reported:
            self._reported.add(text)
            tqdm.write(f"warning: {text}; skipped, {self.count} so far", file=sys.stderr)

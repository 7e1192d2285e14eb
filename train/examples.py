"""Training examples as an endless, fixed sequence, and their batches: the same for every network."""

import sys
from typing import Any, Protocol

import numpy as np
from torch import Tensor
from torch.utils.data import DataLoader, Dataset
from tqdm import tqdm

from train.schedule import OptimConfig

__all__ = ["Batches", "Examples", "Skips", "Source", "example_loader"]


class Source(Protocol):
    """Where examples are drawn from; can be sent to a loader process."""

    def draw(self, rng: np.random.Generator) -> dict[str, Tensor]:
        """Draw one example; all that is random in it follows from ``rng``."""


class Batches(Protocol):
    """What every data configuration has."""

    @property
    def batch_size(self) -> int:
        """Examples a step."""

    @property
    def workers(self) -> int:
        """Loader processes; 0 loads in the training process."""


class Examples(Dataset):
    """Example number i of an endless, fixed sequence: all that is random follows from (seed, i)."""

    def __init__(self, source: Source, *, seed: int, length: int) -> None:
        self.source, self.seed, self.length = source, seed, length

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        return self.source.draw(np.random.default_rng([self.seed, index]))


def example_loader(source: Source, data: Batches, optim: OptimConfig, first_step: int = 0) -> DataLoader[Any]:
    """Batches ``first_step`` to ``optim.steps`` of a sequence; a resumed run sees what it would have seen."""
    examples = Examples(source, seed=optim.seed, length=optim.steps * data.batch_size)
    return DataLoader(
        examples,
        batch_size=data.batch_size,
        sampler=range(first_step * data.batch_size, len(examples)),
        num_workers=data.workers,
        multiprocessing_context="spawn" if data.workers else None,
        prefetch_factor=4 if data.workers else None,
    )


class Skips:
    """Names everything damaged that is left out, once each, with a count; every loader process by itself."""

    def __init__(self) -> None:
        self._named: set[str] = set()

    @property
    def count(self) -> int:
        """How many there were."""
        return len(self._named)

    def __call__(self, error: Exception) -> None:
        """Note what ``error`` names as damaged."""
        text = " ".join(str(error).split())
        if text not in self._named:
            self._named.add(text)
            tqdm.write(f"warning: {text}; skipped, {self.count} so far", file=sys.stderr)

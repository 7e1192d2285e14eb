"""Data-parallel training in processes that ``torchrun`` starts: each takes its share of every batch.

The settings refer to the whole run and do not depend on the number of processes: ``batch_size`` is the total
of all processes in one step, and steps, rates and seeds stay the same. So a run can stop on one process and
resume on four. Process r of N takes the r-th of N equal parts of every batch; the average of the gradients is
the gradient of the whole batch for a loss that is a mean over examples. A loss that divides by a sum over the
batch is instead normalised by the sum over each part.
"""

import gc
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from typing import Any, cast

import torch
import torch.distributed as dist
from torch import nn
from torch.nn.parallel import DistributedDataParallel
from torch.utils.data import DataLoader

from bokehnet.errors import ConfigError, DataFileError, ParameterError
from train.run.stopping import leave_signals_to_the_parent

__all__ = ["Processes", "joined"]

# Timeout of the other processes while the first one validates; a dead process is detected at once.
TIMEOUT = timedelta(hours=2)


@dataclass(frozen=True)
class Processes:
    """Processes that train together; all must call every method that returns a result.

    Attributes:
        rank: Index of this process, from 0.
        count: Number of processes; a single one never waits.
    """

    rank: int = 0
    count: int = 1

    @classmethod
    def current(cls) -> "Processes":
        """Return the processes joined by :func:`joined`, or a single process."""
        return cls(dist.get_rank(), dist.get_world_size()) if dist.is_initialized() else cls()

    @property
    def first(self) -> bool:
        """True if this process writes files and messages."""
        return self.rank == 0

    def check_batch(self, batch_size: int) -> None:
        """Raise ``ConfigError`` unless a batch can be divided into equal shares."""
        if batch_size % self.count:
            raise ConfigError(
                f"data.batch_size = {batch_size} is shared by all processes; expected a multiple of their "
                f"number, found {self.count} processes; change data.batch_size or --nproc-per-node"
            )

    def check_same(self, step: int) -> None:
        """Raise ``DataFileError`` unless all processes resume from the same step."""
        if self._maxima([step, -step]) != [step, -step]:
            raise DataFileError(
                f"process {self.rank} found a checkpoint of step {step}, another one does not; put --out on "
                "a disk that all processes see"
            )

    def share(self, loader: DataLoader[Any], device: torch.device) -> DataLoader[Any]:
        """Return a loader that loads only this process's share of every batch.

        Pins memory for a CUDA device; loader processes ignore signals to stop.
        """
        if loader.batch_sampler is None:
            expected = "a DataLoader with a batch_size or a batch_sampler"
            raise ParameterError("loader", expected, loader, shown="one without")
        return DataLoader(
            loader.dataset,
            batch_sampler=_Shares(loader.batch_sampler, self),
            num_workers=loader.num_workers,
            collate_fn=loader.collate_fn,
            pin_memory=device.type == "cuda",
            worker_init_fn=partial(leave_signals_to_the_parent, loader.worker_init_fn),
            multiprocessing_context=loader.multiprocessing_context,
            prefetch_factor=loader.prefetch_factor,
        )

    def wrap(self, module: nn.Module, device: torch.device) -> nn.Module:
        """Return ``module`` with the first process's weights and gradients averaged over all processes."""
        if self.count == 1:
            return module
        devices = [device] if device.type == "cuda" else None
        return DistributedDataParallel(module, device_ids=devices, broadcast_buffers=False)

    def anywhere(self, *flags: bool) -> list[bool]:
        """Return for each flag whether it is set in any process."""
        return [bool(x) for x in self._maxima([int(flag) for flag in flags])]

    def mean(self, values: dict[str, float]) -> dict[str, float]:
        """Return the means over all processes, which must have the same keys."""
        if self.count == 1:
            return values
        sums = torch.tensor(list(values.values()), dtype=torch.float64)
        dist.all_reduce(sums)
        return dict(zip(values, (sums / self.count).tolist(), strict=True))

    def use_cores(self, device: torch.device, workers: int) -> None:
        """Share the cores of this machine with the loaders and the other processes.

        One thread more than cores delays every barrier: four times slower, measured.
        """
        local_processes = int(os.environ.get("LOCAL_WORLD_SIZE", "1")) if self.count > 1 else 1
        if device.type == "cpu" and (workers or local_processes > 1):
            torch.set_num_threads(max(1, (os.cpu_count() or 1) // local_processes - workers))

    def _maxima(self, numbers: list[int]) -> list[int]:
        if self.count == 1:
            return numbers
        maxima = torch.tensor(numbers)
        dist.all_reduce(maxima, dist.ReduceOp.MAX)
        return cast(list[int], maxima.tolist())


class _Shares:
    """Batch sampler that yields one process's share of each batch of indices."""

    def __init__(self, batches: Iterable[list[int]], processes: Processes) -> None:
        self.batches, self.processes = batches, processes

    def __iter__(self) -> Iterator[list[int]]:
        for batch in self.batches:
            self.processes.check_batch(len(batch))
            size = len(batch) // self.processes.count
            start = self.processes.rank * size
            yield batch[start : start + size]


@contextmanager
def joined(device: torch.device) -> Iterator[torch.device]:
    """Join the processes that ``torchrun`` started, if any, and yield the device of this one.

    Args:
        device: ``cpu`` or ``cuda``; without an index under ``torchrun``, which gives each process a device.
    """
    if not dist.is_torchelastic_launched():
        yield device
        return
    if device.type == "cuda":
        device = _own_gpu(device, int(os.environ["LOCAL_RANK"]))
    # Host tensors use gloo, so that an agreement to stop never waits for a GPU.
    dist.init_process_group("cpu:gloo,cuda:nccl" if device.type == "cuda" else "gloo", timeout=TIMEOUT)
    try:
        yield device
    finally:
        # An object that still holds the group, such as a wrapped module in a reference cycle, would end its
        # threads only at interpreter shutdown and sometimes abort the process.
        gc.collect()
        dist.destroy_process_group()


def _own_gpu(device: torch.device, number: int) -> torch.device:
    gpus = torch.cuda.device_count()
    if device.index is not None or number >= gpus:
        raise ParameterError(
            "--device",
            f"cuda, and under torchrun at most one process for each of the {gpus} GPUs",
            str(device),
            f"use --device cuda and --nproc-per-node {gpus}",
            shown=f"{device} in process {number}",
        )
    torch.cuda.set_device(number)
    return torch.device("cuda", number)

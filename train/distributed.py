"""One run in several processes, as ``torchrun`` starts them: each takes its share of every batch.

The settings speak of the whole run, whatever the number of processes: ``batch_size`` is what all of them
see in one step, and steps, rates and seeds stay as they are. So a run may be stopped on one process and go
on with four. Process r of N takes the r-th of N equal parts of every batch; the gradients are averaged,
which is the gradient of the whole batch for a loss that is a mean over examples. A loss that divides by
a sum over the batch is normalised by the sum over each part instead.
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
from train.stopping import leave_signals_to_the_parent

__all__ = ["Processes", "joined"]

# The others wait this long while the first one validates; a process that dies is noticed at once.
PATIENCE = timedelta(hours=2)


@dataclass(frozen=True)
class Processes:
    """The processes that train together; all methods with a result are called by all of them at once.

    Attributes:
        rank: Number of this process, from 0.
        count: How many there are; 1 needs no partner and waits for none.
    """

    rank: int = 0
    count: int = 1

    @classmethod
    def current(cls) -> "Processes":
        """Return the processes that :func:`joined` brought together; alone without it."""
        return cls(dist.get_rank(), dist.get_world_size()) if dist.is_initialized() else cls()

    @property
    def first(self) -> bool:
        """Whether this process writes the files and talks to the user."""
        return self.rank == 0

    def check_batch(self, batch_size: int) -> None:
        """Raise ``ConfigError`` unless a batch can be cut into equal shares."""
        if batch_size % self.count:
            raise ConfigError(
                f"data.batch_size = {batch_size} is shared by all processes; expected a multiple of their "
                f"number, found {self.count} processes; change data.batch_size or --nproc-per-node"
            )

    def check_same(self, step: int) -> None:
        """Raise ``DataFileError`` unless all processes resume from the same step."""
        if self._largest([step, -step]) != [step, -step]:
            raise DataFileError(
                f"process {self.rank} found a checkpoint of step {step}, another one does not; put --out on "
                "a disk that all processes see"
            )

    def share(self, loader: DataLoader[Any], device: torch.device) -> DataLoader[Any]:
        """Return a loader of this process's share of every batch; it loads no more than that.

        Pages are locked for a CUDA device, and signals to stop are left to the training process.
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
        """Return ``module`` with gradients averaged over the processes, and with the first one's weights."""
        if self.count == 1:
            return module
        devices = [device] if device.type == "cuda" else None
        return DistributedDataParallel(module, device_ids=devices, broadcast_buffers=False)

    def anywhere(self, *flags: bool) -> list[bool]:
        """Return for each flag whether it is set in some process."""
        return [bool(x) for x in self._largest([int(flag) for flag in flags])]

    def mean(self, values: dict[str, float]) -> dict[str, float]:
        """Return the means over all processes, which have the same keys."""
        if self.count == 1:
            return values
        sums = torch.tensor(list(values.values()), dtype=torch.float64)
        dist.all_reduce(sums)
        return dict(zip(values, (sums / self.count).tolist(), strict=True))

    def use_cores(self, device: torch.device, workers: int) -> None:
        """Share the processor's cores with the loaders and with the other processes of this machine.

        A thread more than there are cores makes every barrier wait for it: measured, four times slower.
        """
        here = int(os.environ.get("LOCAL_WORLD_SIZE", "1")) if self.count > 1 else 1
        if device.type == "cpu" and (workers or here > 1):
            torch.set_num_threads(max(1, (os.cpu_count() or 1) // here - workers))

    def _largest(self, numbers: list[int]) -> list[int]:
        if self.count == 1:
            return numbers
        found = torch.tensor(numbers)
        dist.all_reduce(found, dist.ReduceOp.MAX)
        return cast(list[int], found.tolist())


class _Shares:
    """Batches of indices, cut down to one process's share."""

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
    """Join the processes that ``torchrun`` started, if it did, and give the device of this one.

    Args:
        device: ``cpu``, or ``cuda`` without a number under ``torchrun``, where each process gets its own.
    """
    if not dist.is_torchelastic_launched():
        yield device
        return
    if device.type == "cuda":
        device = _own_gpu(device, int(os.environ["LOCAL_RANK"]))
    # Numbers of the host go through gloo, so that agreeing on a stop never waits for a GPU.
    dist.init_process_group("cpu:gloo,cuda:nccl" if device.type == "cuda" else "gloo", timeout=PATIENCE)
    try:
        yield device
    finally:
        # Whatever still holds the group, as a wrapped module in a cycle does, would end its threads only
        # while the interpreter goes down, and sometimes abort the process.
        gc.collect()
        dist.destroy_process_group()


def _own_gpu(device: torch.device, number: int) -> torch.device:
    found = torch.cuda.device_count()
    if device.index is not None or number >= found:
        raise ParameterError(
            "--device",
            f"cuda, and under torchrun at most a process for each of the {found} GPUs here",
            str(device),
            f"use --device cuda and --nproc-per-node {found}",
            shown=f"{device} in process {number}",
        )
    torch.cuda.set_device(number)
    return torch.device("cuda", number)

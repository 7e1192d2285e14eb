"""A run of ``train.run.loop.train`` that takes no time: tiny network, mean squared error, nothing to load.

``python -m tests.unit.train.toy_run --config FILE --out FOLDER``, or the same behind ``torchrun``.
"""

import multiprocessing
import os
import signal
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset

from train.run.command import run_command
from train.run.distributed import Processes
from train.run.loop import OptimConfig, train


@dataclass(frozen=True, kw_only=True)
class ToyData:
    batch_size: int = 4
    workers: int = 0


@dataclass(frozen=True, kw_only=True)
class ToyModel:
    dropout: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ToyRun:
    """A run, and its accidents.

    Attributes:
        stop_step, stop_rank: In this step this process gets a polite kill.
        kill_step: In this step process 1 kills itself, once.
        shaken_step: In this step the loader processes get Ctrl-C and a polite kill.
        bad_from, bad_to: From one step until before the other, gradients are not finite.
    """

    optim: OptimConfig
    data: ToyData = field(default_factory=ToyData)
    model: ToyModel = field(default_factory=ToyModel)
    stop_step: int = -1
    stop_rank: int = 1
    kill_step: int = -1
    shaken_step: int = -1
    bad_from: int = 0
    bad_to: int = 0


class Pairs(Dataset):
    """Pair number i of a fixed sequence: six numbers and a function of them."""

    def __len__(self) -> int:
        return 1_000_000

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        rng = torch.Generator().manual_seed(index)
        x = torch.rand(6, generator=rng)
        return {"x": x, "y": x.square().sum()[None], "index": torch.tensor(index)}


def batches(config: ToyRun, step: int) -> DataLoader:
    size = config.data.batch_size
    indices = range(step * size, config.optim.steps * size)
    workers = config.data.workers
    context = "spawn" if workers else None
    return DataLoader(
        Pairs(), batch_size=size, sampler=indices, num_workers=workers, multiprocessing_context=context
    )


def network(config: ToyRun) -> nn.Module:
    torch.manual_seed(config.optim.seed)
    return nn.Sequential(nn.Linear(6, 32), nn.Tanh(), nn.Dropout(config.model.dropout), nn.Linear(32, 1))


def run(config: ToyRun, out: Path, device: torch.device, max_minutes: float) -> Path:
    rank = int(os.environ.get("RANK", "0"))

    def loss_of(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        step = int(batch["index"][0]) // config.data.batch_size
        if step == config.stop_step and rank == config.stop_rank:
            os.kill(os.getpid(), signal.SIGTERM)
        if step == config.kill_step and Processes.current().rank == 1 and not (out / "killed").exists():
            (out / "killed").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if step == config.shaken_step:
            for process in multiprocessing.active_children():
                os.kill(process.pid, signal.SIGINT)
                os.kill(process.pid, signal.SIGTERM)
        loss = (network(batch["x"]) - batch["y"]).square().mean()
        if config.bad_from <= step < config.bad_to:
            loss = loss * torch.nan
        return loss, {"square": loss}

    def validate(network: nn.Module) -> tuple[dict[str, float], dict[str, Tensor]]:
        assert rank == 0
        return {"bias": float(network[-1].bias)}, {"picture": torch.zeros(3, 4, 4)}

    return train(
        "arnet",
        config,
        network(config),
        out=out,
        device=device,
        loader=lambda step: batches(config, step),
        loss_of=loss_of,
        validate=validate,
        max_minutes=max_minutes,
    )


def main(arguments: Sequence[str] | None = None) -> None:
    run_command(__doc__, ToyRun, run, arguments)


if __name__ == "__main__":
    main()

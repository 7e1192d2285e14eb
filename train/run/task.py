"""Common part of the trainings of all networks: from a configuration to the checkpoint."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from bokehnet.models.checkpoint import build_network, load_weights
from train.data.examples import Source, example_loader
from train.run.learner import LossOf
from train.run.loop import Validate, train

__all__ = ["Task", "run_task"]


@dataclass(frozen=True, kw_only=True)
class Task:
    """Definition of the training of one network.

    Attributes:
        network: Name of the network in checkpoints.
        source: Function that opens the source of its examples.
        loss_of: Function that returns the loss and its terms for one batch or one process's share of it.
        validate: Function that returns scores and pictures (3, H, W) in [0, 1] of the averaged network.
    """

    network: str
    source: Callable[[], Source]
    loss_of: LossOf
    validate: Validate


def run_task(task: Task, config: Any, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train a network, or resume its training.

    Args:
        task: Training to run.
        config: Configuration of the run, with ``model``, ``data`` and ``optim``. An optional ``start`` names
            a checkpoint or a folder of exported networks with the initial weights of a new run.
        out: Folder of the run.
        device: Device that trains.
        max_minutes: Time limit, minutes; the run then writes a checkpoint and stops. Run again to resume.

    Returns:
        Path of the final checkpoint.

    Raises:
        Stopped: The run was interrupted or reached its time limit; the checkpoint is written.
    """
    torch.manual_seed(config.optim.seed)
    network = build_network(task.network, config.model)
    if start := getattr(config, "start", ""):
        load_weights(network, Path(start), task.network)
    return train(
        task.network,
        config,
        network,
        out=out,
        device=device,
        loader=lambda step: example_loader(
            task.source(),
            config.data,
            seed=config.optim.seed,
            steps=config.optim.steps,
            first_step=step,
        ),
        loss_of=task.loss_of,
        validate=task.validate,
        max_minutes=max_minutes,
    )

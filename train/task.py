"""What the trainings of all networks have in common, from a configuration to the checkpoint."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from bokehnet.models.checkpoint import build_network, load_weights
from train.examples import Source, example_loader
from train.learner import LossOf
from train.loop import Validate, train

__all__ = ["Task", "run_task"]


@dataclass(frozen=True, kw_only=True)
class Task:
    """What is particular to the training of one network.

    Attributes:
        network: Its name in checkpoints.
        source: Opens where its examples come from.
        loss_of: Loss and its parts for one batch or share.
        validate: Scores and pictures (3, H, W) in [0, 1] of the averaged network.
    """

    network: str
    source: Callable[[], Source]
    loss_of: LossOf
    validate: Validate


def run_task(task: Task, config: Any, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train, or go on training.

    Args:
        task: What to train.
        config: The run's configuration, with ``model``, ``data`` and ``optim``. Its ``start``, where it
            has one, is empty, or a checkpoint or folder of exported networks that a new run starts from.
        out: Folder of the run.
        device: Where to compute.
        max_minutes: Stop with a checkpoint after this time; run again to go on.

    Returns:
        Path of the final checkpoint.

    Raises:
        Stopped: Interrupted or out of time; the checkpoint is written.
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
        loader=lambda step: example_loader(task.source(), config.data, config.optim, step),
        loss_of=task.loss_of,
        validate=task.validate,
        max_minutes=max_minutes,
    )

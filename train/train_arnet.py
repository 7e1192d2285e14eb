"""Train ARNet: ``python -m train.train_arnet --config configs/train_arnet.toml --out runs/arnet``."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor, nn

from bokehnet.checks import check_choice
from bokehnet.models.arnet import ARNetConfig
from train.data.crops import DataConfig, PreparedCrops
from train.data.prepared import check_features
from train.run.command import run_command
from train.run.schedule import OptimConfig
from train.run.task import Task, run_task
from train.scores.losses import ERROR_TARGETS, LossWeights, arnet_loss, measured_error
from train.scores.validation import held_out_examples, score_coarse_to_fine

__all__ = ["ARNetRun", "main"]


@dataclass(frozen=True, kw_only=True)
class ARNetRun:
    """A training run of ARNet.

    Attributes:
        data, optim, model, loss: Configurations of these parts.
        held_out: Number of held-out pictures scored at each validation.
        error_target: Training target of the error map, one of ``ERROR_TARGETS``.
        start: Checkpoint or export with initial weights of an ARNet of the same shape; empty for random ones.
    """

    data: DataConfig
    optim: OptimConfig
    model: ARNetConfig = field(default_factory=ARNetConfig)
    loss: LossWeights = field(default_factory=LossWeights)
    held_out: int = 24
    error_target: str = "geometric"
    start: str = ""

    def __post_init__(self) -> None:
        check_choice("error_target", self.error_target, ERROR_TARGETS)


def task(config: ARNetRun, device: torch.device) -> Task:
    """Return the definition of this training."""
    held_out = held_out_examples(config.data.validation, config.held_out)
    check_features(config.model.see_features, held_out.classical)
    radius = config.model.network_max_radius

    def loss_of(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        bokeh, error_map = network(batch["image"], batch["defocus"], batch["classical"], batch["features"])
        classical, truth, target = batch["classical"], batch["truth"], batch["target"]
        if config.error_target == "measured":
            target = measured_error(classical, truth)
        return arnet_loss(bokeh, error_map, classical, truth, target, config.loss)

    return Task(
        network="arnet",
        source=lambda: PreparedCrops(config.data, radius),
        loss_of=loss_of,
        validate=lambda network: score_coarse_to_fine(network, None, radius, held_out, device),
    )


def run(config: ARNetRun, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train, or resume training; return the path of the checkpoint."""
    return run_task(task(config, device), config, out, device, max_minutes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    run_command(__doc__, ARNetRun, run, arguments)


if __name__ == "__main__":
    main()

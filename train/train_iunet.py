"""Train IUNet behind a frozen ARNet.

``python -m train.train_iunet --config configs/train_iunet.toml --out runs/iunet``
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor, nn

from bokehnet.arrays.pyramid import downsample2
from bokehnet.inference.coarse_to_fine import render_neural
from bokehnet.models.checkpoint import load_network
from bokehnet.models.iunet import IUNetConfig
from train.data.crops import DataConfig, PreparedCrops
from train.data.prepared import check_features
from train.run.command import run_command
from train.run.schedule import OptimConfig
from train.run.task import Task, run_task
from train.scores.losses import iunet_loss
from train.scores.validation import held_out_examples, score_coarse_to_fine

__all__ = ["IUNetRun", "main"]


@dataclass(frozen=True, kw_only=True)
class IUNetRun:
    """A training run of IUNet.

    Attributes:
        arnet: Checkpoint or export of the trained ARNet, which stays fixed.
        data, optim, model: Configurations of these parts.
        held_out: Number of held-out pictures scored at each validation.
    """

    arnet: str
    data: DataConfig
    optim: OptimConfig
    model: IUNetConfig = field(default_factory=IUNetConfig)
    held_out: int = 24


def task(config: IUNetRun, device: torch.device) -> Task:
    """Return the definition of this training."""
    arnet = load_network(Path(config.arnet), "arnet").requires_grad_(False).to(device)
    held_out = held_out_examples(config.data.validation, config.held_out)
    check_features(config.model.see_features, held_out.classical)
    radius = config.model.network_max_radius

    def loss_of(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        # At least one upsampling step; half of the examples start one size lower and train two.
        small = float(batch["defocus"].abs().max()) <= radius
        result = render_neural(
            batch["image"],
            batch["defocus"],
            batch["classical"],
            batch["classical_error_map"],
            features=batch["features"],
            arnet=arnet,
            iunet=network,
            network_max_radius=radius,
            extra_halvings=1 if small else int(batch["extra_halvings"][0]),
        )
        losses = []
        truth, target = batch["truth"], batch["target"]
        for bokeh in reversed(result.steps[1:]):
            losses.append(iunet_loss(bokeh, truth, target))
            truth, target = downsample2(truth), downsample2(target)
        parts = {key: torch.stack([part[key] for _, part in losses]).mean() for key in losses[0][1]}
        return torch.stack([loss for loss, _ in losses]).mean(), parts

    return Task(
        network="iunet",
        source=lambda: PreparedCrops(config.data),
        loss_of=loss_of,
        validate=lambda network: score_coarse_to_fine(arnet, network, radius, held_out, device),
    )


def run(config: IUNetRun, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train, or resume training; return the path of the checkpoint."""
    return run_task(task(config, device), config, out, device, max_minutes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    run_command(__doc__, IUNetRun, run, arguments)


if __name__ == "__main__":
    main()

"""Train ARNet: ``python -m train.train_arnet --config configs/train_arnet.toml --out runs/arnet``."""

from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor, nn

from bokehnet.checks import check_choice
from bokehnet.models.arnet import ARNet, ARNetConfig
from bokehnet.models.checkpoint import load_network
from train.command import run_command
from train.data import DataConfig, example_loader
from train.loop import OptimConfig, train
from train.losses import ERROR_TARGETS, arnet_loss, measured_error
from train.validation import held_out_examples, score_coarse_to_fine

__all__ = ["ARNetRun", "main"]


@dataclass(frozen=True, kw_only=True)
class ARNetRun:
    """A training run of ARNet.

    Attributes:
        data, optim, model: See there.
        held_out: Held-out pictures scored at each validation.
        error_target: What the error map is to learn, one of ``ERROR_TARGETS``.
        start: Checkpoint of an ARNet of the same shape whose weights a new run starts from; empty for none.
    """

    data: DataConfig
    optim: OptimConfig
    model: ARNetConfig = field(default_factory=ARNetConfig)
    held_out: int = 24
    error_target: str = "geometric"
    start: str = ""

    def __post_init__(self) -> None:
        check_choice("error_target", self.error_target, ERROR_TARGETS)


def run(config: ARNetRun, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train, or go on training; returns the checkpoint."""
    torch.manual_seed(config.optim.seed)
    held_out = held_out_examples(config.data.validation, config.held_out)

    def loss_of(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        bokeh, error_map = network(batch["image"], batch["defocus"], batch["classical"], batch["features"])
        classical, truth, target = batch["classical"], batch["truth"], batch["target"]
        if config.error_target == "measured":
            target = measured_error(classical, truth)
        return arnet_loss(bokeh, error_map, classical, truth, target)

    network = ARNet(config.model)
    if config.start:
        network.load_state_dict(load_network(Path(config.start), "arnet").state_dict())
    return train(
        "arnet",
        config,
        network,
        out=out,
        device=device,
        loader=lambda step: example_loader(
            config.data,
            seed=config.optim.seed,
            steps=config.optim.steps,
            first_step=step,
            network_max_radius=config.model.network_max_radius,
        ),
        loss_of=loss_of,
        validate=lambda network: score_coarse_to_fine(
            network, None, config.model.network_max_radius, held_out, device
        ),
        max_minutes=max_minutes,
    )


def main() -> None:
    """Entry of the command line."""
    run_command(__doc__, ARNetRun, run)


if __name__ == "__main__":
    main()

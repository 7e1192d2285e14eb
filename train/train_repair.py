"""Train RepairNet: ``python -m train.train_repair --config configs/train_repair.toml --out runs/repair``."""

import functools
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.checkpoint import load_network
from bokehnet.models.repair import FLAT, RepairNet, RepairNetConfig, extremes
from train.command import run_command
from train.loop import OptimConfig, train
from train.repair_data import RepairDataConfig, RepairExamples, repair_loader

__all__ = ["RepairRun", "main", "repair_loss"]


# Share of the map's span at which a difference of depth counts half.
STEP = 0.05

# Half widths of the windows that tell how large the step near a pixel is.
_WINDOW = (3, 6, 9)


@dataclass(frozen=True, kw_only=True)
class RepairRun:
    """A training run of RepairNet.

    Attributes:
        data, optim, model: See there.
        held_out: Held-out examples scored at each validation.
        start: Checkpoint of a RepairNet of the same shape that a new run starts from; empty for none.
    """

    data: RepairDataConfig
    optim: OptimConfig
    model: RepairNetConfig = field(default_factory=RepairNetConfig)
    held_out: int = 64
    start: str = ""


def step_sizes(truth: Tensor) -> Tensor:
    """Span of the true disparity in the window around each pixel, (B, 1, H, W), at least ``FLAT``."""
    low, high = extremes(truth, _WINDOW)[-1]
    return (high - low).clamp(min=FLAT)


def repair_loss(network: RepairNet, batch: dict[str, Tensor]) -> Tensor:
    """Cross entropy of the place between the extremes around a pixel, weighted by how far apart they are.

    Squared or absolute errors of the disparity taught a fresh network next to nothing: most pixels are
    right, and the others are an arbitrary way off.
    """
    span = batch["span"]
    _, after, low, high = network.place(batch["image"], batch["disparity"], span)
    width = high - low
    wanted = ((batch["truth"] - low) / width.clamp(min=1e-6)).clamp(0, 1)
    weight = width / (width + STEP * span)
    return (weight * F.binary_cross_entropy_with_logits(after, wanted, reduction="none")).mean()


@torch.no_grad()
def _score(
    network: nn.Module, batches: dict[str, list[dict[str, Tensor]]], device: torch.device
) -> dict[str, float]:
    """Share of pixels near true steps that stand more than a quarter of the step off, percent."""
    scores = {}
    for kind, examples in batches.items():
        wrong = {"before": 0.0, "after": 0.0}
        pixels = 0.0
        for example in examples:
            image, disparity, truth, span = (
                example[key][None].to(device) for key in ("image", "disparity", "truth", "span")
            )
            step = step_sizes(truth)
            near = step > 5 * FLAT
            pixels += float(near.sum())
            for key, x in (("before", disparity), ("after", network(image, disparity, span)[0])):
                wrong[key] += float(((x - truth).abs() > 0.25 * step)[near].sum())
        scores |= {f"{kind}/{key}": 100 * count / max(pixels, 1) for key, count in wrong.items()}
    return scores


def run(config: RepairRun, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train, or go on training; returns the checkpoint."""
    torch.manual_seed(config.optim.seed)

    @functools.cache
    def held_out() -> dict[str, list[dict[str, Tensor]]]:
        """Whole held-out examples, augmented and clean."""
        found = {}
        for kind, clean in (("augmented", 0.0), ("clean", 1.0)):
            data = replace(config.data, clean=clean, crop=256)
            examples = RepairExamples([config.data.validation], data, seed=5, length=config.held_out)
            found[kind] = [examples[i] for i in range(config.held_out)]
        return found

    def loss_of(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        assert isinstance(network, RepairNet)
        loss = repair_loss(network, batch)
        return loss, {"error": loss}

    network = RepairNet(config.model)
    if config.start:
        network.load_state_dict(load_network(Path(config.start), "repair").state_dict())
    return train(
        "repair",
        config,
        network,
        out=out,
        device=device,
        loader=lambda step: repair_loader(
            config.data, seed=config.optim.seed, steps=config.optim.steps, first_step=step
        ),
        loss_of=loss_of,
        validate=lambda network: (_score(network, held_out(), device), {}),
        max_minutes=max_minutes,
    )


def main() -> None:
    """Entry of the command line."""
    run_command(__doc__, RepairRun, run)


if __name__ == "__main__":
    main()

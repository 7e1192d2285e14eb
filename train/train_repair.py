"""Train RepairNet: ``python -m train.train_repair --config configs/train_repair.toml --out runs/repair``."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.repair import FLAT, RepairNet, RepairNetConfig, extremes
from train.data.repair_data import RepairDataConfig, held_out_repairs, repair_source
from train.run.command import run_command
from train.run.logbook import over_held_out
from train.run.schedule import OptimConfig
from train.run.task import Task, run_task

__all__ = ["RepairRun", "main", "repair_loss"]


# Disparity difference with weight one half, as a fraction of the map's range.
HALF_WEIGHT_STEP = 0.05

# Half widths of the windows that measure the depth step near a pixel, pixels.
_WINDOW_RADII = (3, 6, 9)


@dataclass(frozen=True, kw_only=True)
class RepairRun:
    """A training run of RepairNet.

    Attributes:
        data, optim, model: Configurations of these parts.
        held_out: Number of held-out examples scored at each validation.
        start: Checkpoint or export with initial weights of a RepairNet of the same shape; empty for random
            ones.
    """

    data: RepairDataConfig
    optim: OptimConfig
    model: RepairNetConfig = field(default_factory=RepairNetConfig)
    held_out: int = 64
    start: str = ""


def step_sizes(truth: Tensor) -> Tensor:
    """Return the range of true disparity around each pixel, at least ``FLAT``, (B, 1, H, W)."""
    low, high = extremes(truth, _WINDOW_RADII)[-1]
    return (high - low).clamp(min=FLAT)


def repair_loss(network: RepairNet, batch: dict[str, Tensor]) -> Tensor:
    """Return the cross entropy of a pixel's position between the local extremes, weighted by their distance.

    Squared or absolute errors of the disparity hardly trained a fresh network: most pixels are right, and the
    errors of the others vary arbitrarily.
    """
    span = batch["span"]
    _, after, low, high = network.position_logits(batch["image"], batch["disparity"], span)
    width = high - low
    target = ((batch["truth"] - low) / width.clamp(min=1e-6)).clamp(0, 1)
    weight = width / (width + HALF_WEIGHT_STEP * span)
    return (weight * F.binary_cross_entropy_with_logits(after, target, reduction="none")).mean()


@torch.no_grad()
def _score(
    network: nn.Module, batches: dict[str, list[dict[str, Tensor]]], device: torch.device
) -> dict[str, float]:
    """Return the percentage of pixels near true depth edges whose error exceeds a quarter of the step."""
    scores = {}
    for kind, examples in batches.items():
        wrong = {"before": 0.0, "after": 0.0}
        pixels = 0.0
        for example in over_held_out(examples):
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


def task(config: RepairRun, device: torch.device) -> Task:
    """Return the definition of this training."""
    held_out = held_out_repairs(config.data, config.held_out)

    def loss_of(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        assert isinstance(network, RepairNet)
        loss = repair_loss(network, batch)
        return loss, {"error": loss}

    return Task(
        network="repair",
        source=lambda: repair_source(config.data),
        loss_of=loss_of,
        validate=lambda network: (_score(network, held_out.examples, device), {}),
    )


def run(config: RepairRun, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train, or resume training; return the path of the checkpoint."""
    return run_task(task(config, device), config, out, device, max_minutes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    run_command(__doc__, RepairRun, run, arguments)


if __name__ == "__main__":
    main()

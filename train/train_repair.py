"""Train RepairNet: ``python -m train.train_repair --config configs/train_repair.toml --out runs/repair``."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.repair import FLAT, RepairNet, RepairNetConfig, extremes
from train.command import run_command
from train.logbook import over_held_out
from train.repair_data import RepairDataConfig, held_out_repairs, repair_source
from train.schedule import OptimConfig
from train.task import Task, run_task

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
        start: Checkpoint or export of a RepairNet of the same shape that a new run starts
            from; empty for none.
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
    """What is particular to this training."""
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
    """Train, or go on training; returns the checkpoint."""
    return run_task(task(config, device), config, out, device, max_minutes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    run_command(__doc__, RepairRun, run, arguments)


if __name__ == "__main__":
    main()

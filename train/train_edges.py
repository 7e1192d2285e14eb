"""Train EdgeNet: ``python -m train.train_edges --config configs/train_edges.toml --out runs/edges``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.edges import EdgeNet, EdgeNetConfig
from bokehnet.models.repair import FLAT, extremes
from train.command import run_command
from train.edge_data import EdgeDataConfig, edge_source, held_out_edges
from train.logbook import over_held_out
from train.schedule import OptimConfig
from train.task import Task, run_task

__all__ = ["EdgeRun", "edge_loss", "main"]

# Share of the map's span at which a difference of depth counts half.
STEP = 0.05

# Half widths of the windows that tell how large the step near a pixel is.
_WINDOW = (3, 6)

# Density of disparities that no surface explains, per span of the map.
_OUTLIERS = 0.05


@dataclass(frozen=True, kw_only=True)
class EdgeRun:
    """A training run of EdgeNet.

    Attributes:
        data, optim, model: See there.
        held_out: Held-out examples scored at each validation.
        start: Checkpoint or export of an EdgeNet of the same shape that a new run starts
            from; empty for none.
    """

    data: EdgeDataConfig
    optim: OptimConfig
    model: EdgeNetConfig = field(default_factory=EdgeNetConfig)
    held_out: int = 48
    start: str = ""


def _steps(map_: Tensor) -> Tensor:
    """Span of a map in the window around each pixel, (B, 1, H, W)."""
    low, high = extremes(map_, _WINDOW)[-1]
    return high - low


def edge_loss(network: EdgeNet, batch: dict[str, Tensor]) -> Tensor:
    """Minus the log-likelihood of the disparities inside each pixel, weighted by the steps nearby."""
    span = batch["span"]
    found = network.surfaces(batch["image"], batch["disparity"], span)
    share = F.logsigmoid(found.evidence), F.logsigmoid(-found.evidence)
    inside = batch["inside"]
    parts = [
        weight - (inside - middle).abs() / scale - (2 * scale / span).log()
        for weight, middle, scale in zip(
            share, (found.near, found.far), (found.near_scale, found.far_scale), strict=True
        )
    ]
    likely = torch.logsumexp(torch.stack([*parts, torch.full_like(inside, math.log(_OUTLIERS))]), 0)
    step = torch.maximum(_steps(batch["truth"]), _steps(batch["disparity"]))
    weight = step / (step + STEP * span)
    return -(weight * likely).mean()


@torch.no_grad()
def _score(
    network: nn.Module, batches: dict[str, list[dict[str, Tensor]]], device: torch.device
) -> dict[str, float]:
    """Near true steps: pixels over a quarter of the step off, and mean error of shares; percent."""
    scores = {}
    for kind, examples in batches.items():
        wrong = {"before": 0.0, "after": 0.0, "share_before": 0.0, "share_after": 0.0}
        pixels = mixed = 0.0
        for example in over_held_out(examples):
            image, disparity, truth, inside, span = (
                example[key][None].to(device) for key in ("image", "disparity", "truth", "inside", "span")
            )
            near, far, evidence = network(image, disparity, span).split(1, dim=1)
            low, high = extremes(truth, (3,))[-1]
            step = (high - low).clamp(min=FLAT)
            edge = step > 5 * FLAT
            pixels += float(edge.sum())
            chosen = torch.where(evidence > 0, near, far)
            for key, x in (("before", disparity), ("after", chosen)):
                wrong[key] += float(((x - truth).abs() > 0.25 * step)[edge].sum())
            middle = 0.5 * (inside.amax(1, keepdim=True) + inside.amin(1, keepdim=True))
            two = (inside.amax(1, keepdim=True) - inside.amin(1, keepdim=True)) > 0.05
            true_share = (inside > middle).float().mean(1, keepdim=True)
            mixed += float(two.sum())
            for key, x in (("share_before", (truth > middle).float()), ("share_after", evidence.sigmoid())):
                wrong[key] += float((x - true_share).abs()[two].sum())
        scores |= {f"{kind}/{key}": 100 * wrong[key] / max(pixels, 1) for key in ("before", "after")}
        scores |= {
            f"{kind}/{key}": 100 * wrong[key] / max(mixed, 1) for key in ("share_before", "share_after")
        }
    return scores


def task(config: EdgeRun, device: torch.device) -> Task:
    """What is particular to this training."""
    held_out = held_out_edges(config.data, config.held_out)

    def loss_of(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        assert isinstance(network, EdgeNet)
        loss = edge_loss(network, batch)
        return loss, {"likelihood": loss}

    return Task(
        network="edges",
        source=lambda: edge_source(config.data),
        loss_of=loss_of,
        validate=lambda network: (_score(network, held_out.examples, device), {}),
    )


def run(config: EdgeRun, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train, or go on training; returns the checkpoint."""
    return run_task(task(config, device), config, out, device, max_minutes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    run_command(__doc__, EdgeRun, run, arguments)


if __name__ == "__main__":
    main()

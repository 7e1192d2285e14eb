"""Train LightNet: ``python -m train.train_light --config configs/train_light.toml --out runs/light``."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.models.light import CLOSED_FORM, LightNetConfig
from train.data.light_data import LightDataConfig, LightExamples, held_out_regions
from train.run.command import run_command
from train.run.schedule import OptimConfig
from train.run.task import Task, run_task

__all__ = ["LightRun", "disc_error", "light_loss", "main"]

# Radii of the discs that the loss renders, pixels.
_RADII_PX = (3.0, 8.0, 20.0, 50.0)

# Weight of the absolute error of the logarithmic gain, which guides where discs are saturated, and of the
# probability of light.
_LOG_WEIGHT, _LIGHT_WEIGHT = 0.02, 0.02

# Mean gain from which a region is light.
_LIGHT_GAIN = 1.5


@dataclass(frozen=True, kw_only=True)
class LightRun:
    """A training run of LightNet.

    Attributes:
        data, optim, model: Configurations of these parts.
        start: Checkpoint or export with initial weights; empty for random ones.
    """

    data: LightDataConfig
    optim: OptimConfig
    model: LightNetConfig = field(default_factory=LightNetConfig)
    start: str = ""


def disc_error(gain: Tensor, batch: dict[str, Tensor]) -> Tensor:
    """Return the squared error of the stored discs of regions, times their area, (B, radii).

    A disc of radius R turns a region of area A into one of about (sqrt(A) + sqrt(pi) R)^2, with the flux of
    the region over that area, in addition to the light around it. Cameras store it with the sRGB curve.

    Args:
        gain: Gain on the stored light, (B, 3).
        batch: Regions, with ``stored`` and ``true`` sums (B, 3), ``area`` (B,) and ``surround`` (B, 3).
    """
    errors = []
    for radius in _RADII_PX:
        area = (batch["area"].sqrt() + np.sqrt(np.pi) * radius).square()[:, None]
        discs = [flux / area + batch["surround"] for flux in (gain * batch["stored"], batch["true"])]
        predicted, true = (linear_to_srgb(disc.clamp(0, 1)) for disc in discs)
        errors.append(area[:, 0] * (predicted - true).square().mean(-1))
    return torch.stack(errors, -1)


def light_loss(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the loss of a batch of pictures with some regions each, and its terms.

    Examples are drawn by the area of a disc, so the loss is the mean error of discs over their pixels.
    """
    batch = {name: x.flatten(0, 1) for name, x in batch.items()}
    log_gain, probability = network(batch["features"])
    true = (batch["true"] / batch["stored"]).log2()
    area = (batch["area"].sqrt()[:, None] + np.sqrt(np.pi) * torch.tensor(_RADII_PX)).square()
    disc = (disc_error(log_gain.exp2(), batch) / area).mean()
    logs = (log_gain - true).abs().mean()
    is_light = (true.mean(-1, keepdim=True).exp2() > _LIGHT_GAIN).float()
    light = F.binary_cross_entropy(probability.clamp(1e-4, 1 - 1e-4), is_light)
    return disc + _LOG_WEIGHT * logs + _LIGHT_WEIGHT * light, {"disc": disc, "log": logs, "light": light}


@torch.no_grad()
def score(network: nn.Module, regions: dict[str, Tensor], is_light: np.ndarray) -> dict[str, float]:
    """Return the change of the disc error from the closed form, dB, for scenes with light and with matter.

    Positive is better. All regions count by the area of their discs.
    """
    log_gain, _ = network(regions["features"])
    closed, learned = (
        disc_error(gain.exp2(), regions).mean(-1).numpy()
        for gain in (regions["features"][:, CLOSED_FORM], log_gain)
    )
    scores = {}
    for name, chosen in (("light", is_light), ("matter", ~is_light)):
        before, after = float(closed[chosen].sum()), float(learned[chosen].sum())
        scores[f"{name}/dB"] = 10 * np.log10(max(before, 1e-9) / max(after, 1e-9))
    return scores


def task(config: LightRun) -> Task:
    """Return the definition of this training."""
    regions, is_light = held_out_regions(config.data.validation)
    return Task(
        network="light",
        source=lambda: LightExamples(config.data.folder),
        loss_of=light_loss,
        validate=lambda network: (score(network, regions, is_light), {}),
    )


def run(config: LightRun, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train, or resume training; return the path of the checkpoint."""
    return run_task(task(config), config, out, device, max_minutes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    run_command(__doc__, LightRun, run, arguments)


if __name__ == "__main__":
    main()

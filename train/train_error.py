"""Train ErrorNet: ``python -m train.train_error --config configs/train_error.toml --out runs/error``."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from scipy.stats import spearmanr
from torch import Tensor, nn

from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.models.error import FEATURES, ErrorNetConfig
from train.command import run_command
from train.error_data import ErrorCrops, ErrorDataConfig, as_tensors, error_parts
from train.logbook import over_held_out
from train.schedule import OptimConfig
from train.task import Task, run_task

__all__ = ["ErrorRun", "error_loss", "main", "reliability", "true_error"]

# 8-bit levels of the range from black to white.
_LEVELS = 255.0

# How much a pixel counts outside the reach of depth discontinuities.
_OUTSIDE = 0.1

# Groups of pixels, by what is expected of them, in which expected and true errors are compared.
_BINS = 10

# Errors of which nobody sees anything, 8-bit levels.
_SLIGHT = 0.5


@dataclass(frozen=True, kw_only=True)
class ErrorRun:
    """A training run of ErrorNet.

    Attributes:
        data, optim, model: See there.
        held_out: Held-out pictures scored at each validation.
        start: Checkpoint or export of an ErrorNet of the same shape that a new run starts from; empty for
            none.
    """

    data: ErrorDataConfig
    optim: OptimConfig
    model: ErrorNetConfig = field(default_factory=ErrorNetConfig)
    held_out: int = 24
    start: str = ""


def true_error(batch: dict[str, Tensor]) -> Tensor:
    """Mean over colours of |sRGB value of the rays - truth|, 8-bit levels, (B, 1, H, W)."""
    found, wanted = (linear_to_srgb(batch[name].clamp(0, 1)) for name in ("rays", "truth"))
    return _LEVELS * (found - wanted).abs().mean(1, keepdim=True)


def error_loss(expected: Tensor, error: Tensor, error_map: Tensor) -> Tensor:
    """Minus the log-likelihood of the error where it is distributed exponentially with mean ``expected``.

    It is least, for every pixel, where what is expected is the mean of the errors that look alike: a strictly
    proper score of the mean, so that the network is calibrated if it fits.

    Args:
        expected: 8-bit levels, above 0, (B, 1, H, W).
        error: The true one, the same.
        error_map: In [0, 1]; pixels outside of it count less, (B, 1, H, W).

    Source:
        Gneiting, "Making and evaluating point forecasts", JASA 2011, for scores that ask for a mean.
    """
    weight = _OUTSIDE + (1 - _OUTSIDE) * (error_map > 0)
    return (weight * (expected.log() + error / expected)).mean()


def reliability(expected: np.ndarray, error: np.ndarray) -> list[tuple[float, float]]:
    """Mean expected and mean true error of equally many pixels each, from the least to the most expected.

    Args:
        expected: 8-bit levels, (n,).
        error: The true one, the same.
    """
    order = np.argsort(expected, kind="stable")
    parts = [part for part in np.array_split(order, _BINS) if len(part)]
    return [(float(expected[part].mean()), float(error[part].mean())) for part in parts]


def _ask(network: nn.Module, batch: dict[str, Tensor]) -> Tensor:
    expected: Tensor = network(batch["image"], batch["rays"], batch["scatter"], batch["features"])
    return expected


def _error_map(batch: dict[str, Tensor]) -> Tensor:
    place = FEATURES.index("error_map")
    return batch["features"][:, place : place + 1]


@torch.no_grad()
def score(network: nn.Module, held_out: list[dict[str, Tensor]], device: torch.device) -> dict[str, float]:
    """Within reach of edges: rank correlation with the true error, and how far the reliability is off.

    ``calibration`` is the largest ratio, either way, of mean true to mean expected error over bins of pixels,
    half a level added to both; ``spearman`` the mean of the correlations of each picture.
    """
    correlations, pairs = [], []
    for example in over_held_out(held_out):
        batch = {key: x.to(device) for key, x in example.items()}
        near_edges = (_error_map(batch) > 0)[0, 0]
        if int(near_edges.sum()) < _BINS:
            continue
        told, true = (x[0, 0][near_edges].cpu().numpy() for x in (_ask(network, batch), true_error(batch)))
        pairs.append(np.stack([told, true]))
        if np.ptp(told) > 0 and np.ptp(true) > 0:
            correlations.append(float(spearmanr(told, true).statistic))
    if not pairs:
        return {}
    told, true = np.concatenate(pairs, axis=1)
    ratios = [(b + _SLIGHT) / (a + _SLIGHT) for a, b in reliability(told, true)]
    return {
        "spearman": float(np.mean(correlations)) if correlations else 0.0,
        "calibration": max(max(x, 1 / x) for x in ratios),
        "expected": float(told.mean()),
        "error": float(true.mean()),
    }


def _held_out(config: ErrorRun) -> list[dict[str, Tensor]]:
    """Whole examples, spread over the set for validation; (1, C, H, W) each."""
    (prepared,) = ErrorCrops(ErrorDataConfig(folder=config.data.validation, validation="")).sets
    count = min(config.held_out, len(prepared))
    chosen = np.unique(np.linspace(0, len(prepared) - 1, count).astype(int))
    examples = []
    for number in chosen:
        planes = prepared[int(number)]
        parts = error_parts(planes, *(slice(0, side) for side in planes.shape[1:]))
        examples.append({key: x[None] for key, x in as_tensors(parts).items()})
    return examples


def task(config: ErrorRun, device: torch.device) -> Task:
    """What is particular to this training."""
    held_out = _held_out(config)

    def loss_of(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        loss = error_loss(_ask(network, batch), true_error(batch), _error_map(batch))
        return loss, {"likelihood": loss}

    return Task(
        network="error",
        source=lambda: ErrorCrops(config.data),
        loss_of=loss_of,
        validate=lambda network: (score(network, held_out, device), {}),
    )


def run(config: ErrorRun, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train, or go on training; returns the checkpoint."""
    return run_task(task(config, device), config, out, device, max_minutes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    run_command(__doc__, ErrorRun, run, arguments)


if __name__ == "__main__":
    main()

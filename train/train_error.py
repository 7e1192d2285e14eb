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
from train.data.error_data import ErrorCrops, ErrorDataConfig, as_tensors, error_parts
from train.run.command import run_command
from train.run.logbook import over_held_out
from train.run.schedule import OptimConfig
from train.run.task import Task, run_task

__all__ = ["ErrorRun", "error_loss", "main", "reliability", "true_error"]

# Range from black to white, 8-bit levels.
_LEVELS = 255.0

# Weight of a pixel out of reach of depth discontinuities.
_WEIGHT_OUTSIDE = 0.1

# Number of groups of pixels, by expected error, in which expected and true errors are compared.
_BINS = 10

# Invisible error, 8-bit levels.
_INVISIBLE_ERROR = 0.5


@dataclass(frozen=True, kw_only=True)
class ErrorRun:
    """A training run of ErrorNet.

    Attributes:
        data, optim, model: Configurations of these parts.
        held_out: Number of held-out pictures scored at each validation.
        start: Checkpoint or export with initial weights of an ErrorNet of the same shape; empty for random
            ones.
    """

    data: ErrorDataConfig
    optim: OptimConfig
    model: ErrorNetConfig = field(default_factory=ErrorNetConfig)
    held_out: int = 24
    start: str = ""


def true_error(batch: dict[str, Tensor]) -> Tensor:
    """Return the mean over colours of |rays - truth|, sRGB-encoded, 8-bit levels, (B, 1, H, W)."""
    rays, truth = (linear_to_srgb(batch[name].clamp(0, 1)) for name in ("rays", "truth"))
    return _LEVELS * (rays - truth).abs().mean(1, keepdim=True)


def error_loss(expected: Tensor, error: Tensor, error_map: Tensor) -> Tensor:
    """Return the negative log-likelihood of errors with an exponential distribution of mean ``expected``.

    The loss is minimal where the expected error is the mean error of pixels with the same input: a strictly
    proper score of the mean, so that a network that fits is calibrated.

    Args:
        expected: Expected error, 8-bit levels, above 0, (B, 1, H, W).
        error: True error, 8-bit levels, (B, 1, H, W).
        error_map: Error map in [0, 1], (B, 1, H, W); pixels with 0 have a lower weight.

    Source:
        Gneiting, "Making and evaluating point forecasts", JASA 2011, for proper scores of a mean.
    """
    weight = _WEIGHT_OUTSIDE + (1 - _WEIGHT_OUTSIDE) * (error_map > 0)
    return (weight * (expected.log() + error / expected)).mean()


def reliability(expected: np.ndarray, error: np.ndarray) -> list[tuple[float, float]]:
    """Return mean expected and mean true error of equally large groups of pixels, by rising expectation.

    Args:
        expected: Expected errors, 8-bit levels, (n,).
        error: True errors, 8-bit levels, (n,).
    """
    order = np.argsort(expected, kind="stable")
    parts = [part for part in np.array_split(order, _BINS) if len(part)]
    return [(float(expected[part].mean()), float(error[part].mean())) for part in parts]


def _expected_error(network: nn.Module, batch: dict[str, Tensor]) -> Tensor:
    expected: Tensor = network(batch["image"], batch["rays"], batch["scatter"], batch["features"])
    return expected


def _error_map(batch: dict[str, Tensor]) -> Tensor:
    index = FEATURES.index("error_map")
    return batch["features"][:, index : index + 1]


@torch.no_grad()
def score(network: nn.Module, held_out: list[dict[str, Tensor]], device: torch.device) -> dict[str, float]:
    """Return the rank correlation with the true error and the calibration error, near depth edges.

    ``calibration`` is the largest ratio, above 1, between mean true and mean expected error over bins of
    pixels, after adding half a level to both; ``spearman`` is the mean over pictures of their correlations.
    """
    correlations, pairs = [], []
    for example in over_held_out(held_out):
        batch = {key: x.to(device) for key, x in example.items()}
        near_edges = (_error_map(batch) > 0)[0, 0]
        if int(near_edges.sum()) < _BINS:
            continue
        expected, true = (
            x[0, 0][near_edges].cpu().numpy() for x in (_expected_error(network, batch), true_error(batch))
        )
        pairs.append(np.stack([expected, true]))
        if np.ptp(expected) > 0 and np.ptp(true) > 0:
            correlations.append(float(spearmanr(expected, true).statistic))
    if not pairs:
        return {}
    expected, true = np.concatenate(pairs, axis=1)
    ratios = [(b + _INVISIBLE_ERROR) / (a + _INVISIBLE_ERROR) for a, b in reliability(expected, true)]
    return {
        "spearman": float(np.mean(correlations)) if correlations else 0.0,
        "calibration": max(max(x, 1 / x) for x in ratios),
        "expected": float(expected.mean()),
        "error": float(true.mean()),
    }


def _held_out(config: ErrorRun) -> list[dict[str, Tensor]]:
    """Return whole examples, evenly spaced in the validation set, (1, C, H, W) each."""
    (prepared,) = ErrorCrops(ErrorDataConfig(folder=config.data.validation, validation="")).sets
    count = min(config.held_out, len(prepared))
    numbers = np.unique(np.linspace(0, len(prepared) - 1, count).astype(int))
    examples = []
    for number in numbers:
        planes = prepared[int(number)]
        parts = error_parts(planes, *(slice(0, side) for side in planes.shape[1:]))
        examples.append({key: x[None] for key, x in as_tensors(parts).items()})
    return examples


def task(config: ErrorRun, device: torch.device) -> Task:
    """Return the definition of this training."""
    held_out = _held_out(config)

    def loss_of(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        loss = error_loss(_expected_error(network, batch), true_error(batch), _error_map(batch))
        return loss, {"likelihood": loss}

    return Task(
        network="error",
        source=lambda: ErrorCrops(config.data),
        loss_of=loss_of,
        validate=lambda network: (score(network, held_out, device), {}),
    )


def run(config: ErrorRun, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train, or resume training; return the path of the checkpoint."""
    return run_task(task(config, device), config, out, device, max_minutes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    run_command(__doc__, ErrorRun, run, arguments)


if __name__ == "__main__":
    main()

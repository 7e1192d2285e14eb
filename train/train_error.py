"""Train ErrorNet: ``python -m train.train_error --config configs/train_error.toml --out runs/error``."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from scipy.stats import spearmanr
from torch import Tensor, nn

from bokehnet.io.color import linear_to_srgb
from bokehnet.models.error import CANDIDATES, ErrorNetConfig
from train.command import run_command
from train.error_data import ErrorCrops, ErrorDataConfig, split_planes
from train.logbook import over_held_out
from train.schedule import OptimConfig
from train.task import Task, run_task

__all__ = ["ErrorRun", "error_loss", "main", "reliability", "true_errors"]

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


def true_errors(batch: dict[str, Tensor]) -> Tensor:
    """Mean over colours of |sRGB value - truth| for each candidate, 8-bit levels, (B, 3, H, W)."""
    wanted = linear_to_srgb(batch["truth"].clamp(0, 1))
    found = [
        (linear_to_srgb(batch[name].clamp(0, 1)) - wanted).abs().mean(1, keepdim=True) for name in CANDIDATES
    ]
    return _LEVELS * torch.cat(found, dim=1)


def error_loss(expected: Tensor, errors: Tensor, error_map: Tensor) -> Tensor:
    """Minus the log-likelihood of the errors where each is distributed exponentially with mean ``expected``.

    It is least, for every pixel, where what is expected is the mean of the errors that look alike: a strictly
    proper score of the mean, so that the network is calibrated if it fits.

    Args:
        expected: 8-bit levels, above 0, (B, C, H, W).
        errors: True ones, the same.
        error_map: In [0, 1]; pixels outside of it count less, (B, 1, H, W).

    Source:
        Gneiting, "Making and evaluating point forecasts", JASA 2011, for scores that ask for a mean.
    """
    weight = _OUTSIDE + (1 - _OUTSIDE) * (error_map > 0)
    return (weight * (expected.log() + errors / expected)).mean()


def reliability(expected: np.ndarray, errors: np.ndarray) -> list[tuple[float, float]]:
    """Mean expected and mean true error of equally many pixels each, from the least to the most expected.

    Args:
        expected: 8-bit levels, (n,).
        errors: True ones, the same.
    """
    order = np.argsort(expected, kind="stable")
    parts = [part for part in np.array_split(order, _BINS) if len(part)]
    return [(float(expected[part].mean()), float(errors[part].mean())) for part in parts]


def _ask(network: nn.Module, batch: dict[str, Tensor]) -> Tensor:
    expected: Tensor = network(
        batch["image"], batch["rays"], batch["scatter"], batch["neural"], batch["features"]
    )
    return expected


@torch.no_grad()
def score(network: nn.Module, held_out: list[dict[str, Tensor]], device: torch.device) -> dict[str, float]:
    """Within reach of edges: rank correlation with the true error, and how far the reliability is off.

    ``calibration`` is the largest ratio, either way, of mean true to mean expected error over bins of pixels,
    half a level added to both; ``spearman`` the mean of the correlations of each picture. ``chosen`` is the
    mean error where that candidate is taken of which least is expected.
    """
    correlations: dict[str, list[float]] = {name: [] for name in CANDIDATES}
    pairs: dict[str, list[np.ndarray]] = {name: [] for name in CANDIDATES}
    chosen = []
    for example in over_held_out(held_out):
        batch = {key: x.to(device) for key, x in example.items()}
        expected, errors = _ask(network, batch)[0], true_errors(batch)[0]
        edge = batch["features"][0, -1] > 0
        if int(edge.sum()) < _BINS:
            continue
        best = expected.argmin(0, keepdim=True)
        chosen.append(float(errors.gather(0, best)[0][edge].mean()))
        for i, name in enumerate(CANDIDATES):
            one, other = expected[i][edge].cpu().numpy(), errors[i][edge].cpu().numpy()
            pairs[name].append(np.stack([one, other]))
            if np.ptp(one) > 0 and np.ptp(other) > 0:
                correlations[name].append(float(spearmanr(one, other).statistic))
    scores = {"chosen": float(np.mean(chosen))} if chosen else {}
    for name in CANDIDATES:
        if not pairs[name]:
            continue
        together = np.concatenate(pairs[name], axis=1)
        ratios = [(true + _SLIGHT) / (told + _SLIGHT) for told, true in reliability(*together)]
        scores |= {
            f"spearman/{name}": float(np.mean(correlations[name])) if correlations[name] else 0.0,
            f"calibration/{name}": max(max(x, 1 / x) for x in ratios),
            f"error/{name}": float(together[1].mean()),
        }
    return scores


def _held_out(config: ErrorRun) -> list[dict[str, Tensor]]:
    """Whole examples, spread over the set for validation; (1, C, H, W) each."""
    (prepared,) = ErrorCrops(ErrorDataConfig(folder=config.data.validation, validation="")).sets
    count = min(config.held_out, len(prepared))
    chosen = np.unique(np.linspace(0, len(prepared) - 1, count).astype(int))
    return [{key: x[None] for key, x in split_planes(prepared[int(i)]).items()} for i in chosen]


def task(config: ErrorRun, device: torch.device) -> Task:
    """What is particular to this training."""
    held_out = _held_out(config)

    def loss_of(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        loss = error_loss(_ask(network, batch), true_errors(batch), batch["features"][:, -1:])
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

"""Schedule of a run: its settings, the learning rate of each step, and averaged weights."""

import copy
import math
from dataclasses import dataclass

import torch
from torch import nn

from bokehnet.errors import ConfigError

__all__ = ["AveragedWeights", "OptimConfig", "averaging_decay", "learning_rate"]

# Learning rate at the end of the run, as a fraction of the peak.
FLOOR = 0.01


@dataclass(frozen=True, kw_only=True)
class OptimConfig:
    """Settings of the optimizer and its schedule.

    Attributes:
        steps: Steps of the whole run; the learning rate decays along a cosine to a hundredth.
        learning_rate: Peak learning rate of AdamW.
        warmup: Steps of linear rise to the peak.
        average: Decay of the exponential moving average of the weights, which validation and export use.
        clip: Maximum norm of the gradient.
        seed: Seed of weights and data.
        checkpoint_every, validate_every, log_every: Intervals in steps.
        checkpoint_minutes: Maximum time between checkpoints, minutes; never interrupts a step or a
            validation.
        bfloat16: Run convolutions in bfloat16 where the processor has instructions for it.
    """

    steps: int
    learning_rate: float = 5e-4
    warmup: int = 200
    average: float = 0.999
    clip: float = 1.0
    seed: int = 0
    checkpoint_every: int = 250
    validate_every: int = 1000
    log_every: int = 25
    checkpoint_minutes: float = 3.0
    bfloat16: bool = True

    def __post_init__(self) -> None:
        minima = {"steps": 1, "warmup": 0, "checkpoint_every": 1, "validate_every": 1, "log_every": 1}
        for key, minimum in minima.items():
            if (value := getattr(self, key)) < minimum:
                raise ConfigError(f"optim.{key}: expected {minimum} or more steps, found {value}")
        for key in ("learning_rate", "clip"):
            if not (value := getattr(self, key)) > 0:
                raise ConfigError(f"optim.{key}: expected above 0, found {value}")
        if not 0 <= self.average < 1:
            raise ConfigError(f"optim.average: expected 0 to below 1, found {self.average}")


def learning_rate(optim: OptimConfig, step: int) -> float:
    """Return the learning rate of ``step``, counted from 0: linear warm-up times a decaying half cosine.

    Source:
        Loshchilov and Hutter, "SGDR: Stochastic gradient descent with warm restarts", ICLR 2017, without
        the restarts.
    """
    rise = min(1.0, (step + 1) / max(1, optim.warmup))
    fall = 0.5 * (1 + math.cos(math.pi * step / optim.steps))
    return optim.learning_rate * rise * (FLOOR + (1 - FLOOR) * fall)


def averaging_decay(decay: float, step: int) -> float:
    """Return the decay of the average after ``step`` steps: small at first, ``decay`` in the limit.

    With a constant decay the average would retain the random initial weights for 1 / (1 - decay) steps.
    """
    return min(decay, step / (step + 10))


class AveragedWeights:
    """Exponential moving average of a network's weights, in a copy that is never trained.

    Source:
        Polyak and Juditsky, "Acceleration of stochastic approximation by averaging", SIAM Journal on Control
        and Optimization 1992; here with exponential weights.
    """

    def __init__(self, network: nn.Module, decay: float) -> None:
        self.network = copy.deepcopy(network).requires_grad_(False).eval()
        self.decay = decay

    @torch.no_grad()
    def follow(self, network: nn.Module, step: int) -> None:
        """Update the average with ``network`` after ``step`` steps; buffers are copied."""
        decay = averaging_decay(self.decay, step)
        for averaged, current in zip(self.network.parameters(), network.parameters(), strict=True):
            averaged.lerp_(current, 1 - decay)
        for averaged, current in zip(self.network.buffers(), network.buffers(), strict=True):
            averaged.copy_(current)

"""How long and how fast a run trains: its settings, the learning rate of each step, the averaged weights."""

import copy
import math
from dataclasses import dataclass

import torch
from torch import nn

from bokehnet.errors import ConfigError

__all__ = ["AveragedWeights", "OptimConfig", "averaging_decay", "learning_rate"]

# The learning rate at the end of the run, as a part of the peak.
FLOOR = 0.01


@dataclass(frozen=True, kw_only=True)
class OptimConfig:
    """How long and how fast.

    Attributes:
        steps: Steps of the whole run; the learning rate falls along a cosine to a hundredth.
        learning_rate: Peak, for AdamW.
        warmup: Steps of linear rise to the peak.
        average: Decay of the exponential average of the weights; the average is what is used.
        clip: Largest norm of the gradient.
        seed: Seed of weights and data.
        checkpoint_every, validate_every, log_every: Steps.
        checkpoint_minutes: Longest time between two checkpoints; a step or a validation is never cut short.
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
        least = {"steps": 1, "warmup": 0, "checkpoint_every": 1, "validate_every": 1, "log_every": 1}
        for key, lowest in least.items():
            if (found := getattr(self, key)) < lowest:
                raise ConfigError(f"optim.{key}: expected {lowest} or more steps, found {found}")
        for key in ("learning_rate", "clip"):
            if not (found := getattr(self, key)) > 0:
                raise ConfigError(f"optim.{key}: expected above 0, found {found}")
        if not 0 <= self.average < 1:
            raise ConfigError(f"optim.average: expected 0 to below 1, found {self.average}")


def learning_rate(optim: OptimConfig, step: int) -> float:
    """Return the rate of step number ``step``, counted from 0: a linear rise times a falling half cosine.

    Source:
        Loshchilov and Hutter, "SGDR: Stochastic gradient descent with warm restarts", ICLR 2017, without
        the restarts.
    """
    rise = min(1.0, (step + 1) / max(1, optim.warmup))
    fall = 0.5 * (1 + math.cos(math.pi * step / optim.steps))
    return optim.learning_rate * rise * (FLOOR + (1 - FLOOR) * fall)


def averaging_decay(decay: float, step: int) -> float:
    """Return the share of the average that stays after ``step`` steps: small at first, at last ``decay``.

    A young average would otherwise remember the random weights of the start for 1 / (1 - decay) steps.
    """
    return min(decay, step / (step + 10))


class AveragedWeights:
    """An exponential average of a network's weights, in a network of its own that is never trained.

    Source:
        Polyak and Juditsky, "Acceleration of stochastic approximation by averaging", SIAM Journal on
        Control and Optimization 1992; with exponential weights, as is usual today.
    """

    def __init__(self, network: nn.Module, decay: float) -> None:
        self.network = copy.deepcopy(network).requires_grad_(False).eval()
        self.decay = decay

    @torch.no_grad()
    def follow(self, network: nn.Module, step: int) -> None:
        """Move towards ``network`` as it is after ``step`` steps; buffers are copied."""
        keep = averaging_decay(self.decay, step)
        for slow, fast in zip(self.network.parameters(), network.parameters(), strict=True):
            slow.lerp_(fast, 1 - keep)
        for slow, fast in zip(self.network.buffers(), network.buffers(), strict=True):
            slow.copy_(fast)

"""Learning rate and averaged weights against their formulas."""

import math
import re

import pytest
import torch
from torch import nn

from bokehnet.errors import ConfigError
from train.run.schedule import AveragedWeights, OptimConfig, averaging_decay, learning_rate


def test_the_rate_rises_in_a_line_and_falls_along_half_a_cosine_to_a_hundredth():
    optim = OptimConfig(steps=1000, learning_rate=2.0, warmup=100)
    assert learning_rate(optim, 0) == pytest.approx(2.0 / 100)
    assert learning_rate(optim, 49) == pytest.approx(
        1.0 * (0.01 + 0.99 * (1 + math.cos(0.049 * math.pi)) / 2)
    )
    assert learning_rate(optim, 500) == pytest.approx(2.0 * 0.505)
    assert learning_rate(optim, 1000) == pytest.approx(0.02)


def test_without_warm_up_the_first_step_has_the_peak():
    assert learning_rate(OptimConfig(steps=10, learning_rate=3.0, warmup=0), 0) == 3.0


def test_a_young_average_forgets_fast():
    """The formula step / (step + 10), until the asked decay is reached."""
    assert averaging_decay(0.999, 1) == pytest.approx(1 / 11)
    assert averaging_decay(0.999, 90) == pytest.approx(0.9)
    assert averaging_decay(0.999, 10**6) == 0.999


def test_the_average_is_the_sum_that_its_definition_unrolls_to():
    """a_n = sum_k w_k (1 - d_k) prod_{j > k} d_j, the start's weights having no share left but prod d."""
    decay, values = 0.3, [1.0, -2.0, 5.0, 4.0]
    network = nn.Linear(1, 1, bias=False)
    network.register_buffer("count", torch.zeros(()))
    nn.init.constant_(network.weight, 7.0)
    average = AveragedWeights(network, decay)
    for step, value in enumerate(values, start=1):
        nn.init.constant_(network.weight, value)
        network.count += 1
        average.follow(network, step)
    decays = [min(decay, n / (n + 10)) for n in (1, 2, 3, 4)]
    expected = 7.0 * math.prod(decays)
    expected += sum(x * (1 - decays[k]) * math.prod(decays[k + 1 :]) for k, x in enumerate(values))
    assert float(average.network.weight) == pytest.approx(expected)
    assert float(average.network.count) == 4
    assert not average.network.training
    assert not average.network.weight.requires_grad


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"steps": 0}, "optim.steps: expected 1 or more steps, found 0"),
        ({"validate_every": 0}, "optim.validate_every: expected 1 or more steps, found 0"),
        ({"warmup": -1}, "optim.warmup: expected 0 or more steps, found -1"),
        ({"learning_rate": math.nan}, "optim.learning_rate: expected above 0, found nan"),
        ({"clip": 0.0}, "optim.clip: expected above 0, found 0.0"),
        ({"average": 1.0}, "optim.average: expected 0 to below 1, found 1.0"),
    ],
)
def test_a_schedule_that_cannot_be_is_refused(values, message):
    with pytest.raises(ConfigError, match=f"^{re.escape(message)}$"):
        OptimConfig(**{"steps": 10, **values})

"""One step of training: what it changes, and when it is not taken."""

import math

import pytest
import torch
from torch import nn

from bokehnet.errors import ParameterError
from train.run.distributed import Processes
from train.run.learner import FiniteGuard, Learner, has_bfloat16
from train.run.schedule import OptimConfig

CPU = torch.device("cpu")


def learner_of(loss_of, network=None, **optim) -> Learner:
    torch.manual_seed(3)
    network = network or nn.Linear(2, 1)
    settings = OptimConfig(**{"steps": 100, "warmup": 0, "bfloat16": False, **optim})
    return Learner(network, settings, loss_of, CPU, Processes())


def squared(network, batch):
    loss = network(batch["x"]).square().mean()
    return loss, {"square": loss}


def test_the_first_step_is_that_of_adamw_by_hand():
    """Loshchilov and Hutter, ICLR 2019: after one step m / sqrt(v) is the sign, and decay is apart."""
    learner = learner_of(squared, learning_rate=0.1, clip=1e9)
    before = learner.network.weight.detach().clone()
    batch = {"x": torch.tensor([[1.0, -2.0]])}
    sign = torch.sign(learner.network(batch["x"]).detach() * batch["x"])
    scalars = learner.advance(batch)
    torch.testing.assert_close(learner.network.weight.detach(), before * (1 - 0.1 * 1e-4) - 0.1 * sign)
    assert learner.step == 1
    assert set(scalars) == {"loss/sum", "loss/square", "gradient_norm"}


def test_the_gradient_is_clipped_to_its_norm_bound_and_the_full_norm_is_returned():
    learner = learner_of(lambda network, batch: (network(batch["x"]).sum(), {}), clip=0.5)
    scalars = learner.advance({"x": torch.tensor([[3.0, 4.0]])})
    grads = torch.cat([p.grad.flatten() for p in learner.network.parameters()])
    assert float(grads.norm()) == pytest.approx(0.5, rel=1e-4)
    assert float(scalars["gradient_norm"]) == pytest.approx(math.sqrt(26))


def test_a_step_without_finite_gradient_leaves_the_weights_and_counts():
    learner = learner_of(squared)
    before = learner.network.weight.detach().clone()
    learner.advance({"x": torch.tensor([[torch.inf, 1.0]])})
    assert torch.equal(learner.network.weight, before)
    assert (learner.step, learner.guard.skipped, learner.guard.in_a_row) == (1, 1, 1)
    learner.advance({"x": torch.ones(1, 2)})
    assert not torch.equal(learner.network.weight, before)
    assert (learner.step, learner.guard.skipped, learner.guard.in_a_row) == (2, 1, 0)


def test_the_guard_gives_up_after_many_in_a_row_but_not_after_as_many_in_all():
    guard, good, bad = FiniteGuard(patience=3), torch.tensor(1.0), torch.tensor(torch.nan)
    passed = [guard.passes(norm, 0) for norm in (bad, bad, good, bad, bad, good)]
    assert passed == [False, False, True, False, False, True]
    guard.passes(bad, 8)
    guard.passes(bad, 9)
    with pytest.raises(
        ParameterError, match="expected a finite gradient, got none in 3 steps in a row up to step 10"
    ):
        guard.passes(bad, 10)


def test_restored_state_goes_on_bit_for_bit_even_where_the_network_draws_lots():
    """Dropout is drawn from the number of the step, not from what was drawn before."""
    batches = [{"x": torch.randn(4, 2, generator=torch.Generator().manual_seed(i))} for i in range(6)]

    def make() -> nn.Module:
        torch.manual_seed(3)
        return nn.Sequential(nn.Linear(2, 16), nn.Dropout(0.5), nn.Linear(16, 1))

    straight, first, second = (learner_of(squared, make()) for _ in range(3))
    for batch in batches:
        straight.advance(batch)
    for batch in batches[:3]:
        first.advance(batch)
    second.restore(first.state())
    torch.rand(5)
    for batch in batches[3:]:
        second.advance(batch)
    for part in ("network", "raw"):
        for key, weights in straight.state()[part].items():
            assert torch.equal(weights, second.state()[part][key])


def test_bfloat16_is_used_where_the_processor_has_it(monkeypatch):
    seen = []

    def loss_of(network, batch):
        y = network(batch["x"])
        seen.append(y.dtype)
        return y.float().square().mean(), {}

    for instructions in (True, False):
        monkeypatch.setattr("torch.cpu.get_capabilities", lambda result=instructions: {"amx_bf16": result})
        assert has_bfloat16(CPU) is instructions
        for expected in (True, False):
            learner_of(loss_of, bfloat16=expected).advance({"x": torch.ones(1, 2)})
    assert seen == [torch.bfloat16, torch.float32, torch.float32, torch.float32]

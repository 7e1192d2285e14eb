"""One step of training, and the state that steps change."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn

from bokehnet.errors import ParameterError
from train.distributed import Processes
from train.schedule import AveragedWeights, OptimConfig, learning_rate

__all__ = ["FiniteGuard", "Learner", "LossOf", "has_bfloat16"]

# Loss and its parts for one batch.
LossOf = Callable[[nn.Module, dict[str, Tensor]], tuple[Tensor, dict[str, Tensor]]]

# So many steps in a row without a finite gradient are no accident any more.
PATIENCE = 25


def has_bfloat16(device: torch.device) -> bool:
    """Return whether bfloat16 pays on ``device``: it has instructions for it."""
    if device.type == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    found = torch.cpu.get_capabilities()
    return bool(found.get("amx_bf16", False) or found.get("avx512_bf16", False))


class FiniteGuard:
    """Counts the steps whose gradient is not finite, and gives up after ``patience`` of them in a row.

    Attributes:
        skipped: How many there were since this start of the run.
        in_a_row: How many of them came last, one after the other.
    """

    def __init__(self, patience: int = PATIENCE) -> None:
        self.patience = patience
        self.skipped = self.in_a_row = 0

    def passes(self, norm: Tensor, step: int) -> bool:
        """Return whether a gradient of this norm is finite, so that the step may be taken.

        Raises:
            ParameterError: It was not, and neither were the ones before it.
        """
        if torch.isfinite(norm):
            self.in_a_row = 0
            return True
        self.skipped += 1
        self.in_a_row += 1
        if self.in_a_row >= self.patience:
            raise ParameterError(
                "optim.learning_rate",
                "a finite gradient",
                shown=f"none in {self.in_a_row} steps in a row up to step {step}",
                remedy="look at the first batch of them in bad_batch-*.pt in --out, and use a smaller one or "
                "`optim.bfloat16` = false in another --out",
            )
        return False


class _Objective(nn.Module):
    """The loss as a module, so that gradients can be averaged however often ``loss_of`` runs the network."""

    def __init__(self, network: nn.Module, loss_of: LossOf) -> None:
        super().__init__()
        self.network, self.loss_of = network, loss_of

    def forward(self, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        loss, parts = self.loss_of(self.network, batch)
        return loss, {key: part.detach() for key, part in parts.items()}


class Learner:
    """A network in training, its averaged weights and its optimizer.

    Attributes:
        network: What is trained.
        average: The weights to use.
        guard: Counts skipped steps.
        step: Steps done.
    """

    def __init__(
        self,
        network: nn.Module,
        optim: OptimConfig,
        loss_of: LossOf,
        device: torch.device,
        processes: Processes,
    ) -> None:
        self.optim, self.device, self.processes = optim, device, processes
        self.average = AveragedWeights(network, optim.average)
        self.average.network.to(device)
        self.network = network.to(device, memory_format=torch.channels_last)
        self.objective = processes.wrap(_Objective(self.network, loss_of), device)
        self.optimizer = torch.optim.AdamW(network.parameters(), lr=optim.learning_rate, weight_decay=1e-4)
        self.guard = FiniteGuard()
        self.step = 0
        bfloat16 = optim.bfloat16 and has_bfloat16(device)
        self._autocast = torch.autocast(device.type, torch.bfloat16, enabled=bfloat16)

    def advance(
        self, batch: dict[str, Tensor], keep: Callable[..., object] = lambda **_: None
    ) -> dict[str, Tensor]:
        """Take one step; without a finite gradient the weights stay, but the step counts.

        Args:
            batch: This process's share.
            keep: Called with ``step``, ``batch`` and ``weights`` in the first of some steps in a row without
                a finite gradient.

        Returns:
            Scalars of this process's share: ``loss/sum``, its parts, and ``gradient_norm`` of all shares.
        """
        self._set_rate_and_seed()
        self.network.train()
        with self._autocast:
            loss, parts = self.objective(
                {key: x.to(self.device, non_blocking=True) for key, x in batch.items()}
            )
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), self.optim.clip)
        if self.guard.passes(norm, self.step):
            self.optimizer.step()
        elif self.guard.in_a_row == 1:
            keep(step=self.step, batch=batch, weights=self.network.state_dict())
        self.step += 1
        self.average.follow(self.network, self.step)
        named = {f"loss/{key}": part for key, part in parts.items()}
        return {"loss/sum": loss.detach(), **named, "gradient_norm": norm}

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint holds of all this."""
        return {
            "network": self.average.network.state_dict(),
            "raw": self.network.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "step": self.step,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to what :meth:`state` returned."""
        self.network.load_state_dict(state["raw"])
        self.average.network.load_state_dict(state["network"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.step = state["step"]

    def _set_rate_and_seed(self) -> None:
        """What is random in a step follows from its number and the process, so a resumed run repeats it."""
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate(self.optim, self.step)
        steps = self.optim.seed * self.optim.steps + self.step
        torch.manual_seed(steps * self.processes.count + self.processes.rank)

"""Training step and the state that it changes."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn

from bokehnet.errors import ParameterError
from train.run.distributed import Processes
from train.run.schedule import AveragedWeights, OptimConfig, learning_rate

__all__ = ["FiniteGuard", "Learner", "LossOf", "has_bfloat16"]

# Function that returns the loss and its terms for one batch.
LossOf = Callable[[nn.Module, dict[str, Tensor]], tuple[Tensor, dict[str, Tensor]]]

# Maximum number of consecutive steps without a finite gradient.
MAX_SKIPPED_IN_A_ROW = 25


def has_bfloat16(device: torch.device) -> bool:
    """Return whether ``device`` has bfloat16 instructions."""
    if device.type == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    capabilities = torch.cpu.get_capabilities()
    return bool(capabilities.get("amx_bf16", False) or capabilities.get("avx512_bf16", False))


class FiniteGuard:
    """Counter of steps without a finite gradient; raises after ``patience`` of them in a row.

    Attributes:
        skipped: Number of skipped steps since this start of the run.
        in_a_row: Number of consecutive skipped steps up to now.
    """

    def __init__(self, patience: int = MAX_SKIPPED_IN_A_ROW) -> None:
        self.patience = patience
        self.skipped = self.in_a_row = 0

    def passes(self, norm: Tensor, step: int) -> bool:
        """Return whether a gradient norm is finite, so that the step can be applied.

        Raises:
            ParameterError: ``patience`` consecutive norms were not finite.
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
                remedy="inspect the first of these batches, bad_batch-*.pt in --out, and use a smaller rate "
                "or `optim.bfloat16` = false in another --out",
            )
        return False


class _Objective(nn.Module):
    """Loss as a module, so that gradients are averaged once however often ``loss_of`` runs the network."""

    def __init__(self, network: nn.Module, loss_of: LossOf) -> None:
        super().__init__()
        self.network, self.loss_of = network, loss_of

    def forward(self, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
        loss, parts = self.loss_of(self.network, batch)
        return loss, {key: part.detach() for key, part in parts.items()}


class Learner:
    """Network in training, its averaged weights and its optimizer.

    Attributes:
        network: Network in training.
        average: Averaged weights, for validation and export.
        guard: Counter of skipped steps.
        step: Number of completed steps.
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
        self, batch: dict[str, Tensor], save_bad_batch: Callable[..., object] = lambda **_: None
    ) -> dict[str, Tensor]:
        """Run one step; without a finite gradient the weights stay unchanged, but the step counts.

        Args:
            batch: This process's share of the batch.
            save_bad_batch: Called with ``step``, ``batch`` and ``weights`` at the first of consecutive steps
                without a finite gradient.

        Returns:
            Scalars of this process's share: ``loss/sum``, its terms, and ``gradient_norm`` over all shares.
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
            save_bad_batch(step=self.step, batch=batch, weights=self.network.state_dict())
        self.step += 1
        self.average.follow(self.network, self.step)
        named = {f"loss/{key}": part for key, part in parts.items()}
        return {"loss/sum": loss.detach(), **named, "gradient_norm": norm}

    def state(self) -> dict[str, Any]:
        """Return the state for a checkpoint."""
        return {
            "network": self.average.network.state_dict(),
            "raw": self.network.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "step": self.step,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Restore a state that :meth:`state` returned."""
        self.network.load_state_dict(state["raw"])
        self.average.network.load_state_dict(state["network"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.step = state["step"]

    def _set_rate_and_seed(self) -> None:
        """Set the learning rate and the seed, which depend only on step and process."""
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate(self.optim, self.step)
        steps = self.optim.seed * self.optim.steps + self.step
        torch.manual_seed(steps * self.processes.count + self.processes.rank)

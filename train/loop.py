"""The training loop: resumable after a kill at any step, with curves, pictures and averaged weights."""

import copy
import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from bokehnet.config import dump_json, first_difference, to_dict
from bokehnet.errors import ConfigError, DataFileError
from bokehnet.io.atomic import remove_leftovers, write_text
from bokehnet.models.checkpoint import load_checkpoint, save_checkpoint

__all__ = ["OptimConfig", "Stopped", "train"]


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
    bfloat16: bool = True


class Stopped(Exception):  # noqa: N818 - it ends a run, it is no error
    """The run stopped before its end, with a checkpoint.

    Attributes:
        asked: Stopped by Ctrl-C or a kill, not by its time limit.
    """

    def __init__(self, message: str, asked: bool) -> None:
        super().__init__(message)
        self.asked = asked


@contextmanager
def _stop_request() -> Iterator[Callable[[], bool]]:
    """Turn Ctrl-C and a polite kill into a question that the loop asks between two steps."""
    asked: list[bool] = []
    older = {
        kind: signal.signal(kind, lambda *_: asked.append(1)) for kind in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield lambda: bool(asked)
    finally:
        for kind, handler in older.items():
            signal.signal(kind, handler)


def _learning_rate(optim: OptimConfig, step: int) -> float:
    rise = min(1.0, (step + 1) / max(1, optim.warmup))
    fall = 0.5 * (1 + math.cos(math.pi * step / optim.steps))
    return optim.learning_rate * rise * (0.01 + 0.99 * fall)


def _has_bfloat16(device: torch.device) -> bool:
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported()
    return bool(torch.cpu.get_capabilities().get("amx_bf16", False))


def train(
    name: str,
    config: Any,
    network: nn.Module,
    *,
    out: Path,
    device: torch.device,
    loader: Callable[[int], DataLoader],
    loss_of: Callable[[nn.Module, dict[str, Tensor]], tuple[Tensor, dict[str, Tensor]]],
    validate: Callable[[nn.Module], tuple[dict[str, float], dict[str, Tensor]]],
    max_minutes: float = math.inf,
) -> Path:
    """Train ``network`` to the end of its schedule, or go on where an earlier run was interrupted.

    Args:
        name: The network's name in checkpoints.
        config: The run's configuration, with ``model`` and ``optim``; written to ``out/config.json``.
        network: A fresh network.
        out: Folder of the run: checkpoint ``last.pt``, TensorBoard files.
        device: Where to compute.
        loader: Gives the batches from a step on; what comes must depend on the step alone.
        loss_of: Loss and its parts for one batch.
        validate: Scores and pictures (3, H, W) in [0, 1] of the averaged network.
        max_minutes: Stop with a checkpoint after this time; run again to go on.

    Returns:
        Path of the final checkpoint.

    Raises:
        Stopped: Interrupted or out of time; the checkpoint is written.
        ConfigError: ``out`` holds a run with another configuration.
    """
    optim: OptimConfig = config.optim
    out.mkdir(parents=True, exist_ok=True)
    remove_leftovers(out)
    last = out / "last.pt"
    if device.type == "cpu" and config.data.workers:
        # A thread more than there are cores makes every barrier wait for it: measured, four times slower.
        torch.set_num_threads(max(1, (os.cpu_count() or 1) - config.data.workers))
    average = copy.deepcopy(network).requires_grad_(False).eval().to(device)
    network.to(device, memory_format=torch.channels_last)
    optimizer = torch.optim.AdamW(network.parameters(), lr=optim.learning_rate, weight_decay=1e-4)
    step = 0
    if last.exists():
        state = load_checkpoint(last)
        if difference := first_difference(state["run"], to_dict(config)):
            key, old, new = difference
            raise ConfigError(
                f"{out}: holds a run with {key} = {old!r}, but {new!r} was asked for; choose another --out"
            )
        network.load_state_dict(state["raw"])
        average.load_state_dict(state["network"])
        optimizer.load_state_dict(state["optimizer"])
        step = state["step"]
    write_text(out / "config.json", dump_json(config), error=DataFileError)
    autocast = torch.autocast(device.type, torch.bfloat16, enabled=optim.bfloat16 and _has_bfloat16(device))

    def save() -> None:
        state = {
            "network": average.state_dict(),
            "raw": network.state_dict(),
            "optimizer": optimizer.state_dict(),
            "step": step,
            "run": to_dict(config),
        }
        save_checkpoint(last, name, config.model, state)

    deadline = time.monotonic() + 60 * max_minutes
    with (
        SummaryWriter(out, purge_step=step) as writer,
        _stop_request() as stop_asked,
        tqdm(total=optim.steps, initial=step, desc=name, mininterval=1) as bar,
    ):
        for batch in loader(step) if step < optim.steps else ():
            for group in optimizer.param_groups:
                group["lr"] = _learning_rate(optim, step)
            network.train()
            with autocast:
                loss, parts = loss_of(network, {key: x.to(device) for key, x in batch.items()})
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            norm = nn.utils.clip_grad_norm_(network.parameters(), optim.clip)
            if torch.isfinite(norm):
                optimizer.step()
            step += 1
            bar.update()
            keep = min(optim.average, step / (step + 10))
            with torch.no_grad():
                for slow, fast in zip(average.parameters(), network.parameters(), strict=True):
                    slow.lerp_(fast, 1 - keep)
            if step % optim.log_every == 0:
                writer.add_scalar("loss/sum", float(loss), step)
                for key, part in parts.items():
                    writer.add_scalar(f"loss/{key}", float(part), step)
                writer.add_scalar("gradient_norm", float(norm), step)
                bar.set_postfix(loss=f"{float(loss):.4f}", refresh=False)
            if step % optim.validate_every == 0 or step == optim.steps:
                scores, pictures = validate(average)
                for key, score in scores.items():
                    writer.add_scalar(f"validation/{key}", score, step)
                for key, picture in pictures.items():
                    writer.add_image(key, picture, step)
                bar.write(f"step {step}: " + "  ".join(f"{key} {score:.3f}" for key, score in scores.items()))
            stop = stop_asked() or time.monotonic() > deadline
            if step % optim.checkpoint_every == 0 or stop or step == optim.steps:
                save()
            if stop and step < optim.steps:
                message = f"stopped at step {step} of {optim.steps}; run the same command again to go on"
                raise Stopped(message, stop_asked())
    return last

"""Training loop: resumable after a kill at any step, in one or several processes."""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader

from train.run.distributed import Processes
from train.run.learner import Learner, LossOf
from train.run.logbook import Logbook
from train.run.run_folder import RunFolder
from train.run.schedule import OptimConfig
from train.run.stopping import Stopped, stop_requests

__all__ = ["OptimConfig", "Stopped", "train"]

# Function that returns scores and pictures (3, H, W) in [0, 1] of a network.
Validate = Callable[[nn.Module], tuple[dict[str, float], dict[str, Tensor]]]


def train(
    name: str,
    config: Any,
    network: nn.Module,
    *,
    out: Path,
    device: torch.device,
    loader: Callable[[int], DataLoader],
    loss_of: LossOf,
    validate: Validate,
    max_minutes: float = math.inf,
) -> Path:
    """Train ``network`` to the end of its schedule, or resume an interrupted run.

    With several processes (see ``train.run.distributed``) all call this with the same arguments; the first
    one writes and validates.

    Args:
        name: Name of the network in checkpoints.
        config: Configuration of the run, with ``model``, ``data.batch_size``, ``data.workers`` and ``optim``;
            written to ``out/config.json``.
        network: Network with initial weights.
        out: Folder of the run: checkpoint ``last.pt``, TensorBoard files.
        device: Device that trains.
        loader: Function that returns the loader of whole batches from a step on; a batch must depend only on
            its step. Each process loads its share.
        loss_of: Function that returns the loss and its terms for one batch or one process's share of it.
        validate: Function that returns scores and pictures (3, H, W) in [0, 1] of the averaged network.
        max_minutes: Time limit, minutes; the run then writes a checkpoint and stops. Run again to resume.

    Returns:
        Path of the final checkpoint.

    Raises:
        Stopped: The run was interrupted or reached its time limit; the checkpoint is written.
        ConfigError: ``out`` holds a run with another configuration, or a batch cannot be divided equally
            among the processes.
        ParameterError: The gradient is no longer finite; the batch is saved in ``out``.
    """
    optim: OptimConfig = config.optim
    processes = Processes.current()
    processes.check_batch(config.data.batch_size)
    processes.use_cores(device, config.data.workers)
    folder = RunFolder(out, name, config)
    if processes.first:
        folder.prepare()
    learner = Learner(network, optim, loss_of, device, processes)
    if (state := folder.load()) is not None:
        learner.restore(state)
    processes.check_same(learner.step)
    if processes.first:
        folder.write_config()
    with (
        Logbook(name, out, steps=optim.steps, first_step=learner.step, silent=not processes.first) as logbook,
        stop_requests(max_minutes) as request,
    ):
        batches = processes.share(loader(learner.step), device) if learner.step < optim.steps else ()
        for batch in batches:
            scalars = learner.advance(batch, partial(folder.save_bad_batch, rank=processes.rank))
            _report(learner, scalars, processes, logbook)
            if processes.first and (learner.step % optim.validate_every == 0 or learner.step == optim.steps):
                logbook.validation(*validate(learner.average.network), learner.step)
            interrupted, expired = processes.anywhere(request.interrupted, request.expired)
            stop = learner.step < optim.steps and (interrupted or expired)
            if processes.first and (stop or folder.due(learner.step)):
                folder.save(learner.state())
            if stop:
                message = (
                    f"stopped at step {learner.step} of {optim.steps}; run the same command again to resume"
                )
                raise Stopped(message, interrupted)
    return folder.checkpoint


def _report(learner: Learner, scalars: dict[str, Tensor], processes: Processes, logbook: Logbook) -> None:
    logbook.advance()
    skipped = learner.guard.skipped
    if learner.guard.in_a_row:
        suffix = ", batch saved" if learner.guard.in_a_row == 1 else ""
        count = f"({skipped} since the start)"
        logbook.line(f"step {learner.step}: gradient not finite, step skipped {count}{suffix}")
    if learner.step % learner.optim.log_every == 0:
        means = processes.mean({key: float(x) for key, x in scalars.items()})
        logbook.curves({**means, "skipped_steps": skipped}, learner.step)

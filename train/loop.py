"""The training loop: resumable after a kill at any step, in one process or in several."""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader

from train.distributed import Processes
from train.learner import Learner, LossOf
from train.logbook import Logbook
from train.run_folder import RunFolder
from train.schedule import OptimConfig
from train.stopping import Stopped, stop_requests

__all__ = ["OptimConfig", "Stopped", "train"]

# Scores and pictures (3, H, W) in [0, 1] of a network.
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
    """Train ``network`` to the end of its schedule, or go on where an earlier run was interrupted.

    In several processes (see ``train.distributed``) all call this with the same arguments; the first one
    writes and validates.

    Args:
        name: The network's name in checkpoints.
        config: The run's configuration, with ``model``, ``data.batch_size``, ``data.workers`` and ``optim``;
            written to ``out/config.json``.
        network: A fresh network.
        out: Folder of the run: checkpoint ``last.pt``, TensorBoard files.
        device: Where to compute.
        loader: Gives the whole batches from a step on; what comes must depend on the step alone. Each process
            loads its share of them.
        loss_of: Loss and its parts for one batch or share.
        validate: Scores and pictures (3, H, W) in [0, 1] of the averaged network.
        max_minutes: Stop with a checkpoint after this time; run again to go on.

    Returns:
        Path of the final checkpoint.

    Raises:
        Stopped: Interrupted or out of time; the checkpoint is written.
        ConfigError: ``out`` holds a run with another configuration, or batches have no equal shares.
        ParameterError: The gradient is not finite any more; the batch is saved in ``out``.
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
            asked, late = processes.anywhere(request.asked, request.late)
            stop = learner.step < optim.steps and (asked or late)
            if processes.first and (stop or folder.due(learner.step)):
                folder.save(learner.state())
            if stop:
                message = (
                    f"stopped at step {learner.step} of {optim.steps}; run the same command again to go on"
                )
                raise Stopped(message, asked)
    return folder.checkpoint


def _report(learner: Learner, scalars: dict[str, Tensor], processes: Processes, logbook: Logbook) -> None:
    logbook.advance()
    skipped = learner.guard.skipped
    if learner.guard.in_a_row:
        ending = ", batch saved" if learner.guard.in_a_row == 1 else ""
        count = f"({skipped} since the start)"
        logbook.line(f"step {learner.step}: gradient not finite, step skipped {count}{ending}")
    if learner.step % learner.optim.log_every == 0:
        means = processes.mean({key: float(x) for key, x in scalars.items()})
        logbook.curves({**means, "skipped_steps": skipped}, learner.step)

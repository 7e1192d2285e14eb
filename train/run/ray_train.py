"""Training on a Ray cluster by Ray Train, with the configurations and checkpoints of every other start.

Each worker is one process of :mod:`train.run.distributed`: Ray joins the workers and starts all of them again
when one dies; they resume from the checkpoint in the folder of the run. The workers see the working folder
and ``--out`` of the command under the same paths, and have the same version of this repository.
"""

import functools
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from bokehnet.checks import require_extra
from bokehnet.errors import BokehnetError, ParameterError
from bokehnet.models.checkpoint import load_checkpoint
from bokehnet.processes.cluster import cluster_connection
from train.run.stopping import Stopped

__all__ = ["train_on_ray"]

# Restarts of the workers after failures, before the command fails.
_MAX_RESTARTS = 3

Run = Callable[[Any, Path, torch.device, float], Path]


def _work(run: Run, config: Any, out: Path, device: str, deadline: float, folder: Path) -> None:
    """Train in one worker; ``deadline`` is the end of the run in seconds since the epoch."""
    os.chdir(folder)
    own = torch.device(device)
    if own.type == "cuda":
        import ray.train.torch

        own = ray.train.torch.get_device()
    try:
        run(config, out, own, (deadline - time.time()) / 60)
    except Stopped:  # all workers agree; the command reads the step from the checkpoint
        return


def _count(ray: Any, address: str, batch_size: int, device: torch.device) -> int:
    """Return the number of workers: the most cores or GPUs of the cluster that share a batch equally."""
    kind = "GPU" if device.type == "cuda" else "CPU"
    available = int(ray.cluster_resources().get(kind, 0))
    if not available:
        raise ParameterError("--ray", f"a cluster with {kind}s for --device {device.type}", address)
    return max(count for count in range(1, available + 1) if batch_size % count == 0)


def _user_error(error: BaseException) -> BokehnetError | None:
    """Return the error of this package behind a failure of Ray Train, if there is one."""
    failures = getattr(error, "worker_failures", None)
    causes = [*(failures.values() if isinstance(failures, dict) else ()), error.__cause__]
    for cause in causes:
        while cause is not None:
            if isinstance(cause, BokehnetError):
                return cause
            cause = getattr(cause, "cause", None) or cause.__cause__
    return None


def train_on_ray(
    run: Run, config: Any, out: Path, device: torch.device, max_minutes: float, address: str
) -> Path:
    """Run a training on a cluster; arguments and errors as for the trainings themselves.

    Args:
        run: Training, a module-level function.
        config: Configuration of the run.
        out: Folder of the run, on a disk that all workers see.
        device: ``cpu`` or ``cuda``, without an index.
        max_minutes: Time limit, minutes.
        address: Address of a running cluster, as in :func:`bokehnet.processes.cluster.cluster_connection`.

    Returns:
        Path of the checkpoint.

    Raises:
        Stopped: The time limit ended the run; the checkpoint is written.
        MissingExtraError: Ray Train is not installed.
        ParameterError: There is no cluster at ``address``, or it lacks devices.
        BokehnetError: The workers failed more often than they are started again.
    """
    require_extra("ray", "train-cluster")
    require_extra("pyarrow", "train-cluster")
    with cluster_connection(address, "--ray") as (ray, _):
        import ray.train
        from ray.train.torch import TorchConfig, TorchTrainer

        gpus = device.type == "cuda"
        out = out.resolve()
        trainer = TorchTrainer(
            functools.partial(
                _work, run, config, out, device.type, time.time() + 60 * max_minutes, Path.cwd()
            ),
            torch_config=TorchConfig(backend="cpu:gloo,cuda:nccl" if gpus else "gloo"),
            scaling_config=ray.train.ScalingConfig(
                num_workers=_count(ray, address, config.data.batch_size, device), use_gpu=gpus
            ),
            run_config=ray.train.RunConfig(
                name=f"run-{time.time_ns()}",  # a name of an earlier run would continue that one
                storage_path=str(out / "ray"),
                failure_config=ray.train.FailureConfig(max_failures=_MAX_RESTARTS),
            ),
        )
        try:
            trainer.fit()
        except ray.train.TrainingFailedError as error:
            raise _user_error(error) or BokehnetError(
                f"training on {address} failed: {' '.join(str(error).split())[:400]}"
            ) from error
    step = load_checkpoint(out / "last.pt")["step"]
    if step < config.optim.steps:
        message = f"stopped at step {step} of {config.optim.steps}; run the same command again to resume"
        raise Stopped(message, interrupted=False)
    return out / "last.pt"

"""Run the complete recipe: data, all networks, their scores and the table of the model card.

``python -m train.recipe [--small | --share 0.1] [--config configs/recipe.toml] [--out runs/recipe]``

Prints the plan with the expected times first. Skips finished steps; the same command resumes a killed run.
Independent steps run in parallel; their output goes to ``logs`` in the folder. With CUDA devices the
trainings run one after the other, each on all devices; with ``--ray`` a cluster renders the scenes.
"""

import argparse
import multiprocessing.connection
import shlex
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import torch
from tqdm import tqdm

from bokehnet.errors import BokehnetError, DataFileError
from train.recipe_steps.jobs import Job
from train.recipe_steps.plan import Recipe, Step, load_recipe
from train.recipe_steps.progress import Progress, time_in_words
from train.recipe_steps.queue import Queue

__all__ = ["main", "make"]

_CONFIGS = {False: Path("configs/recipe.toml"), True: Path("configs/recipe_small.toml")}


def _processes(table: dict[str, Any]) -> int:
    """Return the number of CUDA devices that can share the batches of a training; 1 without any."""
    batch, devices = int(table["data"].get("batch_size", 1)), max(1, torch.cuda.device_count())
    return max(count for count in range(1, devices + 1) if batch % count == 0)


def make(recipe: Recipe, out: Path, ray: str | None = None) -> None:
    """Run all steps that are not done yet.

    Args:
        recipe: Recipe to run.
        out: Folder of all outputs; resumes an earlier run there.
        ray: Address of a Ray cluster that renders the scenes.

    Raises:
        ConfigError, DataFileError: Existing output cannot be resumed, or the folder cannot be written.
        SystemExit: A step failed.
        KeyboardInterrupt: Ctrl-C or SIGTERM; trainings have written a checkpoint.
    """
    try:
        for folder in {"logs", *(Path(step.makes.removeprefix("bokehnet/")).parent for step in recipe.steps)}:
            (out / folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataFileError(
            f"{out}: cannot make folders there: {error.strerror}; choose another --out"
        ) from error
    progress = Progress(recipe, out)
    left = [step for step in recipe.steps if not progress.done(step)]
    for step in left:
        progress.check(step)
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    count = len(recipe.steps)
    try:
        with tqdm(total=count, initial=count - len(left), desc="steps", disable=None) as bar:
            scheduler = _Scheduler(progress, left, ray, bar)
            try:
                while scheduler.start():
                    scheduler.wait()
            finally:
                scheduler.stop()
    finally:
        signal.signal(signal.SIGTERM, previous)
    print(f"\n{progress.plan()}\ndone: {out}")


@dataclass(frozen=True)
class _RunningStep:
    step: Step
    cores: int
    job: Job
    started_at: float


class _Scheduler:
    """Scheduler of the steps that run in parallel."""

    def __init__(self, progress: Progress, left: Sequence[Step], ray: str | None, bar: "tqdm[Any]") -> None:
        self.progress, self.recipe, self.ray, self.bar = progress, progress.recipe, ray, bar
        exclusive = torch.cuda.is_available()  # each training takes all devices
        slots = 1 if exclusive else self.recipe.workers
        self._threads = self.recipe.threads or max(1, torch.get_num_threads() // slots)
        self._queue = Queue(self.recipe, left, slots)
        self._running: dict[int, _RunningStep] = {}

    def start(self) -> bool:
        """Start all steps that can start; return whether any step runs."""
        while (started := self._queue.take()) is not None:
            step, cores = started
            out = self.progress.out
            words = self.recipe.command(step, out, self.ray, cores * self._threads)
            self.bar.write(
                f"[{self.recipe.steps.index(step) + 1}/{len(self.recipe.steps)}] {shlex.join(words)}"
            )
            self.progress.begin(step)
            log = out / "logs" / f"{step.makes.replace('/', '-')}.log"
            job = Job(words, log, self._threads, _processes(self.recipe.table(step)) if step.trains else 1)
            self._running[job.sentinel] = _RunningStep(step, cores, job, time.monotonic())
        self.bar.set_postfix_str(", ".join(active.step.makes for active in self._running.values()))
        return bool(self._running)

    def wait(self) -> None:
        """Wait up to a second for steps to end.

        Raises:
            SystemExit: A step failed.
        """
        self.progress.save_periodically()
        for sentinel in multiprocessing.connection.wait(list(self._running), timeout=1):
            active = self._running[cast(int, sentinel)]
            if self._end(active):
                message = active.job.last_log_line().removeprefix("error: ")
                sys.exit(f"error: {active.step.makes}: {message} (log: {active.job.log})")
            self.bar.write(
                f"{active.step.makes}: done in {time_in_words(time.monotonic() - active.started_at)}"
            )
            self._queue.give_back(active.step, active.cores)
            self.bar.update()

    def stop(self) -> None:
        """Stop all running steps, and wait for them to end."""
        for active in self._running.values():
            active.job.stop()
        for active in list(self._running.values()):
            self._end(active)

    def _end(self, active: _RunningStep) -> int:
        code = active.job.code()
        del self._running[active.job.sentinel]
        self.progress.end(active.step, done=code == 0)
        return code


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--config", type=Path, help=f"TOML file of the steps; default {_CONFIGS[False]}")
    parser.add_argument(
        "--small", action="store_true", help=f"use {_CONFIGS[True]}, a recipe of a few minutes"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("runs/recipe"), help="output folder; default %(default)s"
    )
    parser.add_argument("--dry-run", action="store_true", help="print the plan and do nothing")
    parser.add_argument(
        "--commands", action="store_true", help="print the command of each step and do nothing"
    )
    parser.add_argument(
        "--seed", type=int, help="seed of all trainings; default: that of their configurations"
    )
    parser.add_argument(
        "--share",
        type=float,
        help="fraction of all scenes and training steps, for a trial: 0.1 takes a tenth of the time",
    )
    parser.add_argument("--ray", metavar="ADDRESS", help="render scenes on this Ray cluster")
    options = parser.parse_args(arguments)
    if options.small and options.config is not None:
        parser.error("expected --small or --config, not both")
    try:
        recipe = load_recipe(options.config or _CONFIGS[options.small])
        if options.seed is not None:
            recipe = recipe.with_seed(options.seed)
        if options.share is not None:
            recipe = recipe.with_share(options.share)
        if options.commands:
            print("\n".join(shlex.join(recipe.command(step)) for step in recipe.steps))
            return
        print(Progress(recipe, options.out).plan(), flush=True)
        if not options.dry_run:
            make(recipe, options.out, options.ray)
    except BokehnetError as error:
        sys.exit(f"error: {' '.join(str(error).split())}")
    except KeyboardInterrupt:
        print("stopped; run the same command again to resume", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()

"""Make everything from nothing: data, all networks, their scores and the table of the model card.

``python -m train.recipe [--small | --share 0.1] [--config configs/recipe.toml] [--out runs/recipe]``

The plan comes first, with its expected hours. What is done is not done again, and a killed start goes on
where it stood when the same command is given again. Steps that need nothing of each other run side by side;
what they print goes to ``logs`` in the folder. With CUDA devices each training takes all of them, one after
the other; with ``--ray`` a cluster renders the scenes.
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
from train.recipe_jobs import Job
from train.recipe_plan import Recipe, Step, load_recipe
from train.recipe_progress import Progress, time_in_words
from train.recipe_queue import Queue

__all__ = ["main", "make"]

_CONFIGS = {False: Path("configs/recipe.toml"), True: Path("configs/recipe_small.toml")}


def _processes(table: dict[str, Any]) -> int:
    """How many CUDA devices can share the batches of a training; 1 without any."""
    batch, devices = int(table["data"].get("batch_size", 1)), max(1, torch.cuda.device_count())
    return max(count for count in range(1, devices + 1) if batch % count == 0)


def make(recipe: Recipe, out: Path, ray: str | None = None) -> None:
    """Do all steps that are not done yet.

    Args:
        recipe: What to make.
        out: Folder in which everything is made; an older start goes on there.
        ray: Address of a Ray cluster that renders the scenes.

    Raises:
        ConfigError, DataFileError: What is there cannot be gone on with, or the folder cannot be written.
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
    older = signal.signal(signal.SIGTERM, signal.default_int_handler)
    count = len(recipe.steps)
    try:
        with tqdm(total=count, initial=count - len(left), desc="steps", disable=None) as bar:
            running = _Running(progress, left, ray, bar)
            try:
                while running.start():
                    running.wait()
            finally:
                running.stop()
    finally:
        signal.signal(signal.SIGTERM, older)
    print(f"\n{progress.plan()}\ndone: {out}")


@dataclass(frozen=True)
class _Begun:
    step: Step
    cores: int
    job: Job
    at: float


class _Running:
    """The steps that run side by side."""

    def __init__(self, progress: Progress, left: Sequence[Step], ray: str | None, bar: "tqdm[Any]") -> None:
        self.progress, self.recipe, self.ray, self.bar = progress, progress.recipe, ray, bar
        alone = torch.cuda.is_available()  # each training takes all devices
        places = 1 if alone else self.recipe.workers
        self._threads = self.recipe.threads or max(1, torch.get_num_threads() // places)
        self._queue = Queue(self.recipe, left, places)
        self._begun: dict[int, _Begun] = {}

    def start(self) -> bool:
        """Start all that can start; false if nothing runs."""
        while (taken := self._queue.take()) is not None:
            step, cores = taken
            out = self.progress.out
            words = self.recipe.command(step, out, self.ray, cores * self._threads)
            self.bar.write(
                f"[{self.recipe.steps.index(step) + 1}/{len(self.recipe.steps)}] {shlex.join(words)}"
            )
            self.progress.begin(step)
            log = out / "logs" / f"{step.makes.replace('/', '-')}.log"
            job = Job(words, log, self._threads, _processes(self.recipe.table(step)) if step.trains else 1)
            self._begun[job.sentinel] = _Begun(step, cores, job, time.monotonic())
        self.bar.set_postfix_str(", ".join(begun.step.makes for begun in self._begun.values()))
        return bool(self._begun)

    def wait(self) -> None:
        """Wait a moment for some of them to end.

        Raises:
            SystemExit: One has failed.
        """
        self.progress.go_on()
        for sentinel in multiprocessing.connection.wait(list(self._begun), timeout=1):
            begun = self._begun[cast(int, sentinel)]
            if self._end(begun):
                said = begun.job.last_words().removeprefix("error: ")
                sys.exit(f"error: {begun.step.makes}: {said} (all that it said: {begun.job.log})")
            self.bar.write(f"{begun.step.makes}: done in {time_in_words(time.monotonic() - begun.at)}")
            self._queue.give_back(begun.step, begun.cores)
            self.bar.update()

    def stop(self) -> None:
        """Ask all that still run to stop, and wait until they have."""
        for begun in self._begun.values():
            begun.job.stop()
        for begun in list(self._begun.values()):
            self._end(begun)

    def _end(self, begun: _Begun) -> int:
        code = begun.job.code()
        del self._begun[begun.job.sentinel]
        self.progress.end(begun.step, done=code == 0)
        return code


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--config", type=Path, help=f"TOML file of the steps; default {_CONFIGS[False]}")
    parser.add_argument("--small", action="store_true", help=f"{_CONFIGS[True]}: the same in a few minutes")
    parser.add_argument("--out", type=Path, default=Path("runs/recipe"), help="folder; default %(default)s")
    parser.add_argument("--dry-run", action="store_true", help="print the plan and do nothing")
    parser.add_argument("--commands", action="store_true", help="print the single commands and do nothing")
    parser.add_argument("--seed", type=int, help="of all trainings; default: that of their configurations")
    parser.add_argument(
        "--share", type=float, help="of all scenes and steps, to try it: 0.1 takes a tenth of the time"
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
        print("stopped; run the same command again to go on", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()

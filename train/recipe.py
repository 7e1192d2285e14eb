"""Make everything from nothing: data, all networks, their scores and the table of the model card.

``python -m train.recipe [--small | --share 0.1] [--config configs/recipe.toml] [--out runs/recipe]``

The plan comes first, with its expected hours. What is done is not done again, and a killed start goes on
where it stood when the same command is given again. With several CUDA devices each training takes all of
them; with ``--ray`` a cluster renders the scenes.
"""

import argparse
import contextlib
import importlib
import json
import shlex
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numba
import torch

from bokehnet.errors import BokehnetError, ConfigError, DataFileError
from bokehnet.io.atomic import write_text
from train.recipe_plan import Recipe, Step, load_recipe

__all__ = ["Progress", "main"]

_CONFIGS = {False: Path("configs/recipe.toml"), True: Path("configs/recipe_small.toml")}


def _time(seconds: float) -> str:
    """A time in words, in the unit that suits it."""
    for unit, size in (("h", 3600), ("min", 60)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"


class Progress:
    """What has been done of a recipe, kept in ``recipe.json``.

    Args:
        recipe: The steps.
        out: Folder in which everything is made.

    Raises:
        DataFileError: The file is there and is none of ours.
    """

    def __init__(self, recipe: Recipe, out: Path) -> None:
        self.recipe, self.out = recipe, out
        self._path = out / "recipe.json"
        self._told: dict[str, dict[str, Any]] = {}
        if self._path.exists():
            try:
                steps = json.loads(self._path.read_text(encoding="utf-8"))["steps"]
                self._told = {makes: {**told} for makes, told in steps.items()}
            except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
                raise DataFileError(
                    f"{self._path}: expected what was done of a recipe ({error}); choose another --out"
                ) from error

    def seconds(self, step: Step) -> float:
        """Time that a step has taken in all starts."""
        return float(self._told.get(step.makes, {}).get("seconds", 0.0))

    def done(self, step: Step) -> bool:
        """Whether a step is done as it is asked for now."""
        told = self._told.get(step.makes, {})
        same = told.get("asked") == self.recipe.fingerprint(step)
        return bool(told.get("done") and same and self._path_of(step).exists())

    def check(self, step: Step) -> None:
        """Raise unless a step can go on with what it has begun.

        Raises:
            ConfigError: That was made of what is no more; what else has changed its tool tells by itself.
        """
        told, recipe = self._told.get(step.makes), self.recipe
        if told is None or step.overwrites or not self._path_of(step).exists():
            return
        alike = told.get("own") == recipe.fingerprint(step, with_needs=False)
        if alike and told.get("asked") != recipe.fingerprint(step):
            raise ConfigError(
                f"{self._path_of(step)}: was made of what steps before it made, and these are asked for "
                "otherwise now; remove it or choose another --out"
            )

    def _path_of(self, step: Step) -> Path:
        return self.out / step.makes.removeprefix("bokehnet/")

    def state(self, step: Step) -> str:
        """The same in words."""
        if self.done(step):
            return f"done in {_time(self.seconds(step))}"
        return f"begun, {_time(self.seconds(step))} so far" if self.seconds(step) else "to do"

    def plan(self) -> str:
        """All steps with their expected hours and states, as a table."""
        recipe = self.recipe
        rows = [[step.makes, step.by, _time(recipe.seconds(step)), self.state(step)] for step in recipe.steps]
        widths = [max(len(row[i]) for row in rows) for i in range(3)]
        lines = ["  ".join([*map(str.ljust, row[:3], widths), row[3]]) for row in rows]
        left = sum(recipe.seconds(step) for step in recipe.steps if not self.done(step))
        total = sum(map(recipe.seconds, recipe.steps))
        taken = sum(map(self.seconds, recipe.steps))
        lines.append(
            f"expected: {_time(total)} in all (cores: {recipe.workers}), {_time(left)} of it to do; "
            f"taken: {_time(taken)}"
        )
        return "\n".join(lines)

    @contextlib.contextmanager
    def timed(self, step: Step) -> Iterator[None]:
        """Note that a step is begun, how long it takes and, if it ends well, that it is done."""
        begun, before = time.monotonic(), self.seconds(step)
        own = self.recipe.fingerprint(step, with_needs=False)
        told = {"asked": self.recipe.fingerprint(step), "own": own, "done": False}
        try:
            self._note(step, {**told, "seconds": before})
            yield
            told["done"] = True
        finally:
            self._note(step, {**told, "seconds": before + time.monotonic() - begun})

    def _note(self, step: Step, told: dict[str, Any]) -> None:
        self._told[step.makes] = told
        write_text(self._path, json.dumps({"steps": self._told}, indent=1) + "\n", error=DataFileError)


def _call(words: Sequence[str], processes: int = 1) -> None:
    """Run a command in this process, or behind ``torchrun`` in several.

    Raises:
        SystemExit: It failed or was stopped.
    """
    if words[0] == "bokehnet":
        from bokehnet.cli.app import run

        if code := run(words[1:]):
            sys.exit(code)
        return
    module, arguments = words[2], words[3:]
    if processes > 1:
        from torch.distributed.elastic.multiprocessing.errors import ChildFailedError
        from torch.distributed.run import main as torchrun

        try:
            torchrun(["--standalone", "--nproc-per-node", str(processes), "-m", module, *arguments])
        except ChildFailedError:
            sys.exit(f"error: {module} failed; what it said stands above")
        return
    importlib.import_module(module).main(arguments)


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
        SystemExit: A step failed or was stopped; it has said why.
    """
    try:
        for folder in {(out / step.makes.removeprefix("bokehnet/")).parent for step in recipe.steps}:
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataFileError(
            f"{out}: cannot make folders there: {error.strerror}; choose another --out"
        ) from error
    progress = Progress(recipe, out)
    threads = [
        min(recipe.threads or cores, cores) for cores in (torch.get_num_threads(), numba.get_num_threads())
    ]
    for number, step in enumerate(recipe.steps, 1):
        if progress.done(step):
            continue
        progress.check(step)
        words = recipe.command(step, out, ray)
        print(f"\n[{number}/{len(recipe.steps)}] {shlex.join(words)}", flush=True)
        torch.set_num_threads(threads[0])  # tools that share the cores among processes keep one
        numba.set_num_threads(threads[1])
        with progress.timed(step):
            _call(words, _processes(recipe.table(step)) if step.trains else 1)
    print(f"\n{progress.plan()}\ndone: {out}")


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

"""Command line: run given files once, or mutate seeds until the time is up."""

import argparse
import contextlib
import gc
import importlib
import os
import pkgutil
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from tests.fuzz.child import MAX_SECONDS, Attempt, attempt
from tests.fuzz.commands import check_request_text, commands, write_partners
from tests.fuzz.mutation import mutated
from tests.fuzz.seeds import text_requests, write_seeds

_REPORT_SECONDS, _WARMING_SECONDS = 300.0, 600.0


def run_files(folder: Path, max_seconds: float) -> Counter[str]:
    """Run every command of every file in a folder once, and print a line for each."""
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        partners = Path(name)
        _check(attempt(partial(write_partners, partners), 60), "partners")
        for path in sorted(folder.rglob("*")):
            for task in commands(path, partners) if path.is_file() else ():
                result = attempt(task, max_seconds)
                counts[result.kind] += 1
                _say(_line(path.name, task, result))
    return counts


def fuzz(minutes: float, seed: int, actual: Path | None) -> Counter[str]:
    """Mutate seeds until the time is up; print a line for each finding, and keep its file in ``found``."""
    counts: Counter[str] = Counter()
    end = time.monotonic() + 60 * minutes
    with tempfile.TemporaryDirectory() as name:
        partners, folder = Path(name, "partners"), Path(name, "seeds")
        partners.mkdir()
        _check(attempt(partial(write_partners, partners), 60), "partners")
        _check(attempt(lambda: len(write_seeds(folder)) * 0, 120), "seeds")
        paths, texts = sorted(path for path in folder.iterdir() if path.is_file()), list(text_requests())
        by_suffix: dict[str, list[Path]] = {}
        for path in paths:
            by_suffix.setdefault(path.suffix, []).append(path)
        _say(f"{len(paths)} seeds: {' '.join(sorted(by_suffix))}")
        task: Callable[[], int] | None
        for sources in by_suffix.values():  # so that no attempt compiles a kernel
            for task in commands(sources[0], partners):
                attempt(task, _WARMING_SECONDS)
        number, reported = 0, time.monotonic()
        stopped: list[bool] = []
        signal.signal(signal.SIGTERM, lambda *_: stopped.append(True))
        while time.monotonic() < end and not stopped:
            rng = np.random.default_rng([seed, number])
            number += 1
            if rng.random() < 0.05:
                text = mutated(texts[int(rng.integers(len(texts)))].encode(), ".json", rng)
                result, kept, label = (
                    attempt(partial(check_request_text, text)),
                    text,
                    "request.json",
                )
                task = None
            else:
                suffix = sorted(by_suffix)[int(rng.integers(len(by_suffix)))]
                source = by_suffix[suffix][int(rng.integers(len(by_suffix[suffix])))]
                kept = mutated(source.read_bytes(), suffix, rng)
                path = partners / f"mutated{suffix}"
                path.write_bytes(kept)
                tasks = commands(path, partners)
                if not tasks:
                    continue
                task = tasks[int(rng.integers(len(tasks)))]
                result, label = attempt(task), source.name
            counts[result.kind] += 1
            if result.is_finding:
                _say(f"attempt {number} of seed {seed}: {_line(label, task, result)}\n{result.text[-1500:]}")
                if actual is not None:
                    actual.mkdir(parents=True, exist_ok=True)
                    (actual / f"{seed}_{number}_{result.kind.replace(' ', '_')}_{label}").write_bytes(kept)
            if time.monotonic() > reported + _REPORT_SECONDS:
                reported = time.monotonic()
                _say(f"so far {dict(counts)}")
            for rest in partners.glob(".bokehnet-*"):
                shutil.rmtree(rest) if rest.is_dir() else rest.unlink()
    return counts


def _check(result: Attempt, what: str) -> None:
    if result.kind != "done":
        raise SystemExit(f"cannot write the {what}: {result.kind}: {result.text}")


def _line(name: str, task: Callable[[], int] | None, result: Attempt) -> str:
    words = [Path(word).name if "/" in word else word for word in getattr(task, "words", ["read"])]
    mark = "FINDING" if result.is_finding else "       "
    last = (result.text.strip().splitlines() or [""])[-1]
    return (
        f"{mark} {name[:28]:28} {' '.join(words)[:44]:44} {result.kind:12} {result.seconds:5.1f} s "
        f"{result.peak_bytes / 1e6:5.0f} MB {last[:150]}"
    )


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201


def import_all() -> None:
    """Import the modules of the commands once, before children are forked."""
    rooms = (
        "classical",
        "cli",
        "depth_repair",
        "engines",
        "inference",
        "io",
        "lenses",
        "render",
        "scene",
        "sequence",
        "serve",
    )
    for room in rooms:
        package = importlib.import_module(f"bokehnet.{room}")
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if module.name.startswith(("bokehnet.classical.torch", "bokehnet.classical.cuda")):
                continue
            with contextlib.suppress(ImportError):
                importlib.import_module(module.name)
    gc.collect()
    gc.freeze()  # so that children copy fewer pages


def main() -> int:
    """Parse the command line and run; the exit code is 1 if there was a finding."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=1.0, help="time to fuzz")
    parser.add_argument("--seed", type=int, default=0, help="seed of the random generator")
    parser.add_argument("--found", type=Path, help="folder for the files of findings")
    parser.add_argument("--files", type=Path, help="folder of files to run once, without mutation")
    parser.add_argument("--seconds", type=float, default=MAX_SECONDS, help="time limit with --files")
    options = parser.parse_args()
    import_all()
    if options.files is not None:
        counts = run_files(options.files, options.seconds)
    else:
        counts = fuzz(options.minutes, options.seed, options.found)
    _say(f"{sum(counts.values())} attempts: {dict(counts)}")
    return int(any(kind not in ("done", "refused") for kind in counts))


if __name__ == "__main__":
    result = main()
    sys.stdout.flush()
    os._exit(result)  # without the teardown of the libraries

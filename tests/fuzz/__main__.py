"""Command line: run given files once, or mutate seeds until the time is up."""

import argparse
import contextlib
import importlib
import pkgutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

from tests.fuzz.child import MAX_SECONDS, attempt
from tests.fuzz.commands import commands, write_partners


def run_files(folder: Path, max_seconds: float) -> int:
    """Run every command of every file in a folder; return the number of findings."""
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        partners = Path(name)
        attempt(lambda: write_partners(partners) or 0)
        for path in sorted(folder.rglob("*")):
            if not path.is_file():
                continue
            for task in commands(path, partners):
                result = attempt(task, max_seconds)
                counts[result.kind] += 1
                words = [
                    Path(word).name if "/" in word else word for word in getattr(task, "words", ["session"])
                ]
                mark = "FINDING" if result.is_finding else "       "
                last = result.text.strip().splitlines()[-1:] or [""]
                print(
                    f"{mark} {path.name[:28]:28} {' '.join(words)[:44]:44} {result.kind:12} "
                    f"{result.seconds:5.1f} s {result.peak_bytes / 1e6:5.0f} MB {last[0][:150]}",
                    flush=True,
                )
    print(dict(counts))
    return sum(count for kind, count in counts.items() if kind not in ("done", "refused"))


def import_all() -> None:
    """Import the modules of the commands once, before children are forked."""
    for room in ("cli", "depth_repair", "engines", "inference", "io", "lenses", "render", "scene", "sequence"):
        package = importlib.import_module(f"bokehnet.{room}")
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            with contextlib.suppress(ImportError):
                importlib.import_module(module.name)


def main() -> int:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--files", type=Path, help="folder of files to run once, without mutation")
    parser.add_argument("--seconds", type=float, default=MAX_SECONDS, help="time limit of an attempt")
    options = parser.parse_args()
    import_all()
    if options.files is not None:
        return 1 if run_files(options.files, options.seconds) else 0
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Figures of the documentation: JSON files that benchmark commands write and tables are made from.

A benchmark with the option ``--figures FILE`` writes its rows by :func:`write_figures`.
``python -m tools.figures`` turns the files of ``docs/figures`` into the tables between markers of the pages;
a test checks that they agree.
"""

import json
import subprocess
from collections.abc import Mapping
from pathlib import Path

from bokehnet.io.files.atomic import write_text

__all__ = ["write_figures"]


def _commit() -> str:
    """Return the short name of the commit, with ``+`` where other files than figures differ from it.

    Empty outside git.
    """
    folder = Path(__file__).parent.parent
    name = _git(folder, "rev-parse", "--short=8", "HEAD")
    changed = _git(folder, "status", "--porcelain", "--untracked-files=no", ".", ":!docs/figures")
    return name + "+" * bool(name and changed)


def _git(folder: Path, *words: str) -> str:
    """Return the output of git; empty if it fails."""
    done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else ""


def write_figures(
    path: Path,
    command: str,
    conditions: str,
    columns: Mapping[str, tuple[str, str]],
    rows: Mapping[str, Mapping[str, float]],
) -> None:
    """Write the figures of one command.

    Args:
        path: JSON file.
        command: Command line that was run.
        conditions: Data, size, machine, and the kind of average.
        columns: From the key of a column to its title and the format of its numbers, such as ".2f".
        rows: From the name of a row to its numbers by column; columns that were not measured are absent.
    """
    figures = {
        "command": command,
        "commit": _commit(),
        "conditions": conditions,
        "columns": {key: {"title": title, "format": form} for key, (title, form) in columns.items()},
        "rows": {
            name: {key: round(float(row[key]), 6) for key in columns if key in row}
            for name, row in rows.items()
        },
    }
    write_text(path, json.dumps(figures, indent=1) + "\n")

"""Write the tables of the documentation from ``docs/figures/*.json``: ``python -m tools.figures [--check]``.

A page holds a table between ``<!-- figures: NAME -->`` or ``<!-- figures: NAME | key, key -->`` and
``<!-- end figures -->``. NAME is a file of ``docs/figures``; keys select columns. ``--check`` writes nothing
and fails if a table differs from its figures.
"""

import argparse
import json
import re
import sys
from pathlib import Path

__all__ = ["PAGES", "filled"]

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "docs/figures"
PAGES = [
    ROOT / "README.md",
    ROOT / "bokehnet/weights/MODEL_CARD.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]

_TABLE = re.compile(
    r"(<!-- figures: ([\w-]+)(?: \| ([\w, ]+))? -->\n).*?(<!-- end figures -->)", re.DOTALL | re.MULTILINE
)


def table(name: str, keys: list[str] | None = None) -> str:
    """Return the Markdown table of one figures file, with the command that printed it.

    Raises:
        FileNotFoundError: The file is missing.
        KeyError: The file has no such column.
    """
    figures = json.loads((FIGURES / f"{name}.json").read_text(encoding="utf-8"))
    columns = {key: figures["columns"][key] for key in keys or figures["columns"]}
    lines = ["| | " + " | ".join(column["title"] for column in columns.values()) + " |"]
    lines.append("|---" * (len(columns) + 1) + "|")
    for row, numbers in figures["rows"].items():
        cells = [format(numbers[key], column["format"]) for key, column in columns.items()]
        lines.append(f"| {row} | " + " | ".join(cells) + " |")
    return "\n".join([*lines, "", f"`{figures['command']}`; {figures['conditions']}"])


def filled(text: str) -> str:
    """Return the text of a page with each marked table rewritten from its figures."""

    def write(match: re.Match[str]) -> str:
        keys = [key.strip() for key in match[3].split(",")] if match[3] else None
        return f"{match[1]}{table(match[2], keys)}\n{match[4]}"

    return _TABLE.sub(write, text)


def main() -> int:
    """Write or check the tables of all pages; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="compare only; exit code 1 if a table differs")
    arguments = parser.parse_args()
    stale = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        if filled(text) != text:
            stale.append(str(page.relative_to(ROOT)))
            if not arguments.check:
                page.write_text(filled(text), encoding="utf-8")
    print(", ".join(stale) or "all tables agree with their figures")
    return 1 if stale and arguments.check else 0


if __name__ == "__main__":
    sys.exit(main())

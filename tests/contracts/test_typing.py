"""``py.typed`` means something. Authority: mypy, strict, on uses of the public names."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent / "typing"
ROOT = FOLDER.parents[2]
NUMBER = re.compile(r"  # (\d+)$")


def numbered(name: str) -> dict[int, int]:
    """Line to the number of the use that stands there."""
    lines = (FOLDER / name).read_text(encoding="utf-8").splitlines()
    results = {line: NUMBER.search(text) for line, text in enumerate(lines, start=1)}
    return {line: int(match[1]) for line, match in results.items() if match}


def refused(name: str) -> set[int]:
    """Lines that mypy refuses, as it sees an installed package: by its types alone."""
    pytest.importorskip("mypy")
    words = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", str(FOLDER / name)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode in (0, 1), done.stderr
    return {int(line) for line in re.findall(rf"{name}:(\d+): error", done.stdout)}


@pytest.mark.parametrize("name", ["right.py", "wrong.py"])
def test_there_are_twenty(name):
    assert sorted(numbered(name).values()) == list(range(1, 21))


@pytest.mark.slow
def test_right_uses_are_accepted():
    assert refused("right.py") == set()


@pytest.mark.slow
def test_each_wrong_use_is_refused():
    assert refused("wrong.py") == set(numbered("wrong.py"))

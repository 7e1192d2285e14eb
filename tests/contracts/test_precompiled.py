"""The machine code that the package ships was made from the sources that it ships."""

import json
from pathlib import Path

import pytest

from bokehnet.precompiled.library import FORMAT, PACKAGE, digest, file_digest

TABLES = sorted((PACKAGE / "precompiled").glob("*.json"))
REMEDY = "run python -m benchmarks.precompile"


def test_there_is_a_library():
    assert [path.name for path in TABLES] == ["kernels-x86-64-v3-linux.json"]


@pytest.mark.parametrize("path", TABLES, ids=lambda path: path.stem)
def test_library_and_table_belong_together(path: Path):
    table = json.loads(path.read_text("utf-8"))
    assert table["format"] == FORMAT, REMEDY
    assert table["library"] == file_digest(path.with_suffix(".so")), REMEDY


@pytest.mark.parametrize("path", TABLES, ids=lambda path: path.stem)
def test_no_source_has_changed_since(path: Path):
    """Else numba compiles these kernels: right, but the first picture waits for it."""
    table = json.loads(path.read_text("utf-8"))
    changed = [source for source, stamp in table["sources"].items() if digest(source) != stamp]
    assert changed == [], REMEDY

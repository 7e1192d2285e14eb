"""Kernels are compiled by one function, which works where nothing can be kept, and with damaged files."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import bokehnet
from bokehnet.precompiled.library import OFF

PACKAGE = Path(bokehnet.__file__).parent

TRIPLE = """
from bokehnet.kernels import njit
@njit(cache=True)
def triple(x):
    return 3 * x
if __name__ == "__main__":
    import kernel_file
    assert kernel_file.triple(14) == 42
    assert kernel_file.triple(0.5) == 1.5
    print(sum(kernel_file.triple._cache_hits.values()))
"""


def run(arguments, folder, **changes):
    """Python in ``folder``, without the variables of its environment that are None."""
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    for name, value in changes.items():
        environment.pop(name, None)
        if value is not None:
            environment[name] = str(value)
    words = [sys.executable, *map(str, arguments)]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)


@pytest.fixture
def nowhere(tmp_path):
    """Variables under which no folder for a cache can be made, not even by root, who may write anywhere."""
    (tmp_path / "file").write_text("")
    below = tmp_path / "file" / "below"
    return {"HOME": below, "XDG_CACHE_HOME": below, "NUMBA_CACHE_DIR": below}


@pytest.fixture
def kernel_file(tmp_path):
    """A folder with a program that has one kernel, compiled for two types."""
    folder = tmp_path / "programs"
    folder.mkdir()
    (folder / "kernel_file.py").write_text(TRIPLE)
    return folder


@pytest.mark.slow
def test_without_a_folder_kernels_are_compiled_with_a_notice(kernel_file, nowhere):
    (kernel_file / "__pycache__").write_text("")  # a file: no folder can be made here
    for _ in range(2):
        outcome = run(["kernel_file.py"], kernel_file, **nowhere)
        assert (outcome.returncode, outcome.stdout) == (0, "0\n")
        assert outcome.stderr.count("\n") == 1
        assert "NUMBA_CACHE_DIR" in outcome.stderr


@pytest.mark.slow
def test_an_unwritable_folder_is_numbas_own_failure(kernel_file, nowhere):
    """Without our function the same program dies: this shows that the surroundings are the true ones."""
    source = TRIPLE.replace("from bokehnet.kernels", "from numba")
    (kernel_file / "kernel_file.py").write_text(source)
    (kernel_file / "__pycache__").write_text("")
    outcome = run(["kernel_file.py"], kernel_file, **nowhere)
    assert outcome.returncode == 1
    assert "no locator available" in outcome.stderr


@pytest.mark.slow
def test_a_second_program_finds_the_kernels_of_the_first(kernel_file, tmp_path):
    results = [run(["kernel_file.py"], kernel_file, NUMBA_CACHE_DIR=tmp_path / "cache") for _ in range(2)]
    assert [(outcome.stdout, outcome.stderr) for outcome in results] == [("0\n", ""), ("2\n", "")]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_damaged_files_are_replaced(kernel_file, tmp_path, kind):
    cache = {"NUMBA_CACHE_DIR": tmp_path / "cache"}
    run(["kernel_file.py"], kernel_file, **cache)
    for path in (tmp_path / "cache").rglob(f"*.{kind}"):
        path.write_bytes(path.read_bytes()[:20])
    results = [run(["kernel_file.py"], kernel_file, **cache) for _ in range(2)]
    assert [(outcome.stdout, outcome.stderr) for outcome in results] == [("0\n", ""), ("2\n", "")]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_stops_nothing(kernel_file, tmp_path):
    """/dev/full fails at the first byte written, as a full disk does, after the folder was found writable."""
    source = """
import numba.core.caching as caching
import contextlib
@contextlib.contextmanager
def full(self, path):
    with open("/dev/full", "wb", buffering=0) as file:
        yield file
caching.IndexDataCacheFile._open_for_write = full
import kernel_file
assert kernel_file.triple(14) == 42
assert kernel_file.triple(0.5) == 1.5
"""
    outcome = run(["-c", source], kernel_file, NUMBA_CACHE_DIR=tmp_path / "cache")
    assert outcome.returncode == 0
    assert outcome.stderr.count("\n") == 1
    assert "No space left on device" in outcome.stderr


@pytest.mark.slow
def test_the_line_goes_to_a_programs_own_log(kernel_file, nowhere):
    (kernel_file / "__pycache__").write_text("")
    source = "import logging; logging.basicConfig(filename='log.txt'); import kernel_file as k; k.triple(2)"
    outcome = run(["-c", source], kernel_file, **nowhere)
    assert (outcome.returncode, outcome.stderr) == (0, "")
    assert (kernel_file / "log.txt").read_text().count("NUMBA_CACHE_DIR") == 1


@pytest.mark.slow
def test_a_picture_is_rendered_where_nothing_can_be_written_but_the_picture(tmp_path, nowhere):
    copy = tmp_path / "installed" / "bokehnet"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [copy, *(path for path in copy.rglob("*") if path.is_dir())]:
        (folder / "__pycache__").write_text("")
    source = """
import numpy as np
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.io.image import write_image
defocus = np.zeros((40, 60), np.float32)
defocus[:, 30:] = 5
write_image("map.png", geometric_error_map(defocus)[..., None].repeat(3, 2))
"""
    outcome = run(["-c", source], tmp_path, PYTHONPATH=copy.parent, **nowhere, **{OFF: "1"})
    assert outcome.returncode == 0, outcome.stderr
    assert (tmp_path / "map.png").stat().st_size > 100
    assert outcome.stderr.count("cannot be kept") == 1


def test_no_kernel_is_made_by_another_way():
    """So that one place decides: numba's own decorators stand in one file alone."""
    other = re.compile(r"numba\.n?jit\b|from numba import .*\bn?jit\b|\bvectorize\(|\bcfunc\(")
    results = [path for path in PACKAGE.rglob("*.py") if other.search(path.read_text(encoding="utf-8"))]
    assert results == [PACKAGE / "kernels.py"]

"""Machine code runs only where it fits, and gives what numba gives."""

import gc
import json
import os
import shutil
from pathlib import Path

import numba
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.classical.error_map import geometric_error_map
from bokehnet.classical.layered.background.occluded_background import occluded_background
from bokehnet.classical.rays_renderer import rays
from bokehnet.classical.scatter.disc_table import disc_table
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.optics.aperture import Aperture
from bokehnet.precompiled import library
from bokehnet.precompiled.arguments import describe, flatten
from bokehnet.precompiled.kernel import Kernel, record_calls
from bokehnet.precompiled.results import result_reader

HERE = Path(library.__file__).parent
ARRAYS = "(f4[2C])"
NAME = "bokehnet.classical.error_map._cover_discs"

pytestmark = pytest.mark.skipif(library._open(HERE) is None, reason="no machine code for this machine")


@pytest.fixture
def anew(monkeypatch):
    """A library that is opened, and sources that are read, as if for the first time."""
    monkeypatch.setattr(library, "_open", library._open.__wrapped__)
    monkeypatch.setattr(library, "digest", library.digest.__wrapped__)


def scene(seed=0):
    rng = np.random.default_rng(seed)
    image = rng.random((70, 90, 3), dtype=np.float32)
    defocus = np.full((70, 90), -9, np.float32)
    defocus[20:50, 30:60] = 7
    defocus[60:] = 0
    return image, defocus


def test_a_kernel_is_found_for_its_types_alone(anew):
    assert library.find(NAME, ARRAYS) is not None
    assert library.find(NAME, "(f8[2C])") is None
    assert library.find("bokehnet.nowhere.kernel", ARRAYS) is None


def test_contiguous_arrays_run_code_that_was_made_for_any_strides():
    entries = ["(i8[1A],f4[2C],i8)", "(f8[1C])"]
    assert library._fitting("(i8[1C],f4[2C],i8)", entries) == entries[0]
    assert library._fitting("(i8[1A],f4[2A],i8)", entries) is None
    assert library._fitting("(i8[2C],f4[2C],i8)", entries) is None
    assert library._fitting("(i8[1Cr],f4[2C],i8)", entries) is None
    assert library._fitting("(i8[1C],f4[2C],f8)", entries) is None


@pytest.mark.parametrize("many", [0, 1, 2])
def test_a_picture_with_any_number_of_hidden_pixels_is_left_to_nobody_else(many, monkeypatch):
    found = []
    monkeypatch.setattr(Kernel, "dispatcher", property(lambda self: found.append(self.name)))
    image, defocus = np.full((24, 24, 3), 0.5, np.float32), np.zeros((24, 24), np.float32)
    wanted = np.zeros(defocus.shape, np.bool_)
    defocus[8:16, 8:16] = 6
    wanted[8, 8 : 8 + many] = True
    occluded_background(image, defocus, inpainted=wanted)
    assert found == []


def test_a_changed_source_goes_to_the_compiler(anew, monkeypatch):
    monkeypatch.setattr(library, "digest", lambda source: "of another text")
    assert library.find(NAME, ARRAYS) is None


def test_the_compiler_can_be_asked_for(anew, monkeypatch):
    monkeypatch.setenv(library.OFF, "1")
    assert library.find(NAME, ARRAYS) is None


@pytest.mark.parametrize(("system", "machine"), [("darwin", "x86_64"), ("linux", "aarch64")])
def test_other_machines_go_to_the_compiler(anew, monkeypatch, system, machine):
    monkeypatch.setattr(library.sys, "platform", system)
    monkeypatch.setattr(library.platform, "machine", lambda: machine)
    assert library.find(NAME, ARRAYS) is None


@pytest.fixture
def copies(tmp_path):
    """A folder with copies of libraries and table."""
    for path in HERE.glob("kernels-*"):
        shutil.copy(path, tmp_path)
    return tmp_path


opened = library._open.__wrapped__


def rewritten(folder: Path, **changes) -> None:
    """Change entries of the table."""
    path = library.table_file(folder)
    path.write_text(json.dumps(json.loads(path.read_text("utf-8")) | changes), "utf-8")


def test_the_best_library_that_is_whole_is_taken(copies):
    for processor in library.PROCESSORS:
        found = opened(copies)
        path = library.library_file(copies, processor)
        with path.open("r+b") as file:
            file.truncate(path.stat().st_size - 1)
        fits = found is not None and Path(found[0]._name) == path
        assert fits or processor != "x86-64-v3"  # which these tests need
    assert opened(copies) is None


def test_what_is_missing_or_damaged_is_left_alone(copies):
    assert opened(copies) is not None
    library.table_file(copies).write_text("{", "utf-8")
    assert opened(copies) is None
    library.table_file(copies).unlink()
    assert opened(copies) is None


def test_a_table_of_another_format_is_left_alone(copies):
    rewritten(copies, format=library.FORMAT + 1)
    assert opened(copies) is None


def test_a_library_of_another_c_library_is_left_alone(copies):
    """What the loader refuses: here files that are no libraries, with a table that says they are ours."""
    paths = [library.library_file(copies, processor) for processor in library.PROCESSORS]
    for path in paths:
        path.write_bytes(b"no library")
    digests = [library.file_digest(path) for path in paths]
    rewritten(copies, libraries=dict(zip(library.PROCESSORS, digests, strict=True)))
    assert opened(copies) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "render",
    [
        lambda image, defocus: scatter(image, defocus),
        lambda image, defocus: scatter(image, defocus, Aperture(blades=6, cats_eye=0.5)),
        lambda image, defocus: rays(image, defocus),
        lambda image, defocus: rays(20 * image**8, defocus),
        lambda image, defocus: geometric_error_map(defocus),
    ],
    ids=["scatter", "blades", "rays", "lights", "error map"],
)
def test_pictures_are_those_of_numba(render):
    """Authority: numba's compiler on the same functions. Other instructions may round otherwise."""
    image, defocus = scene()
    with record_calls():
        expected = render(image, defocus)
    assert np.abs(render(image, defocus) - expected).max() <= 1e-5 * max(1.0, np.abs(expected).max())


def called(name, *arguments):
    """What machine code that is looked up now gives."""
    run, flat = library.find(name, describe(arguments)), []
    assert run is not None
    flatten(arguments, flat)
    return run(flat)


@pytest.mark.parametrize("threads", [2, 7, 64])
def test_every_number_of_threads_gives_the_same_result(monkeypatch, threads):
    """More threads than there are cores, or than there are rows, too."""
    defocus, table = np.abs(scene()[1]), disc_table()
    values = np.random.default_rng(0).random((70, 90, 4), np.float32)

    def results():
        out = np.zeros_like(values)
        called("bokehnet.classical.scatter.disc_scatter.scatter_discs", values, defocus, table, out)
        return called(NAME, defocus), out

    monkeypatch.setattr(numba, "get_num_threads", lambda: 1)
    expected = results()
    monkeypatch.setattr(numba, "get_num_threads", lambda: threads)
    for found, wanted in zip(results(), expected, strict=True):
        assert_array_equal(found, wanted)


def test_a_returned_array_can_be_written_and_outlives_the_kernel_that_made_it():
    first = called(NAME, np.full((40, 50), 3, np.float32))
    copy = first.copy()
    for _ in range(20):
        called(NAME, np.full((40, 50), 9, np.float32))
    gc.collect()
    assert_array_equal(first, copy)
    first += 1
    assert_array_equal(first, copy + 1)


def test_memory_of_a_returned_array_goes_back_once_with_its_last_view():
    taken, data = [], np.arange(6.0)

    def release(owner):
        taken.append(owner)

    structure, read = result_reader("f8[2C]", release)
    array = read(structure(5, None, 6, 8, data.ctypes.data, 2, 3, 24, 8))
    assert_array_equal(array, data.reshape(2, 3))
    view = array[1:]
    del array
    gc.collect()
    assert taken == []
    del view
    gc.collect()
    assert taken == [5]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_child_runs_kernels_after_its_parent_did():
    defocus = np.abs(scene()[1])
    expected = called(NAME, defocus)
    child = os.fork()
    if child == 0:
        os._exit(0 if np.array_equal(called(NAME, defocus), expected) else 1)
    assert os.waitpid(child, 0)[1] == 0


def test_what_a_kernel_raises_is_raised():
    """Memory that nobody has: the kernel asks for 2^56 bytes before it reads anything."""
    flat = []
    flatten((np.zeros((1, 1), np.float32), 1, np.zeros((1, 1), np.bool_)), flat)
    flat[2], flat[5:9] = 2**56, (2**28, 2**28, 2**30, 4)
    name = "bokehnet.classical.layered.depth_discontinuities._discontinuity_sides"
    run = library.find(name, "(f4[2C],i8,b1[2C])")
    assert run is not None
    with pytest.raises(MemoryError):
        run(flat)

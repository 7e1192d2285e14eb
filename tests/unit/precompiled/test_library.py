"""Machine code runs only where it fits, and gives what numba gives."""

import gc
import inspect
import json
import os
import shutil
from importlib import metadata
from pathlib import Path

import numba
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.classical import error_map
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.classical.layered.background.occluded_background import occluded_background
from bokehnet.classical.layered.depth_discontinuities import _discontinuity_sides
from bokehnet.classical.layered.layers import split_layers
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.precompiled import library, machine
from bokehnet.precompiled.arguments import describe, flatten
from bokehnet.precompiled.kernel import KERNELS, Kernel, record_calls
from bokehnet.precompiled.results import result_reader

ARRAYS = "(f4[2C])"
COVER = error_map._cover_discs

packed = pytest.mark.skipif(
    library._open(library.FOLDER) is None,
    reason="needs machine code of all kernels: python -m tools.kernel_library",
)


@pytest.fixture(autouse=True)
def _on(monkeypatch):
    monkeypatch.delenv(library.OFF, raising=False)


def scene(seed=0):
    rng = np.random.default_rng(seed)
    image = rng.random((70, 90, 3), dtype=np.float32)
    defocus = np.full((70, 90), -9, np.float32)
    defocus[20:50, 30:60] = 7
    defocus[60:] = 0
    return image, defocus


def test_a_kernel_is_found_for_its_types_alone(built):
    assert library.find(COVER, ARRAYS, built) is not None
    assert library.find(COVER, "(f8[2C])", built) is None
    assert library.find(error_map._sum_rows, ARRAYS, built) is None


def test_contiguous_arrays_use_code_for_any_strides():
    entries = ["(i8[1A],f4[2C],i8)", "(f8[1C])"]
    assert library._matching_entry("(i8[1C],f4[2C],i8)", entries) == entries[0]
    assert library._matching_entry("(i8[1A],f4[2A],i8)", entries) is None
    assert library._matching_entry("(i8[2C],f4[2C],i8)", entries) is None
    assert library._matching_entry("(i8[1Cr],f4[2C],i8)", entries) is None
    assert library._matching_entry("(i8[1C],f4[2C],f8)", entries) is None


@packed
@pytest.mark.parametrize("many", [0, 1, 2])
def test_any_number_of_occluded_pixels_runs_precompiled(many, monkeypatch):
    results = []
    monkeypatch.setattr(Kernel, "dispatcher", property(lambda self: results.append(self.name)))
    image, defocus = np.full((24, 24, 3), 0.5, np.float32), np.zeros((24, 24), np.float32)
    expected = np.zeros(defocus.shape, np.bool_)
    defocus[8:16, 8:16] = 6
    expected[8, 8 : 8 + many] = True
    occluded_background(image, defocus, inpainted=expected)
    assert results == []


@packed
def test_a_picture_of_any_strides_is_split_precompiled(monkeypatch):
    results = []
    monkeypatch.setattr(Kernel, "dispatcher", property(lambda self: results.append(self.name)))
    image, defocus = scene()
    split_layers(image.transpose(1, 0, 2), defocus.T)
    assert results == []


@pytest.fixture
def edited():
    """Function of a kernel of the error map: the same kernel of an edited module."""
    before = dict(KERNELS)

    def edit(kernel, old, new):
        text = inspect.getsource(error_map)
        assert text.count(old) == 1
        namespace = {"__name__": error_map.__name__}
        exec(compile(text.replace(old, new), error_map.__file__, "exec"), namespace)
        return namespace[kernel.function.__name__]

    yield edit
    KERNELS.clear()
    KERNELS.update(before)


def test_a_kernel_with_edited_code_is_left_to_numba(built, edited):
    assert library.find(edited(COVER, "x + half + 1", "x + half + 2"), ARRAYS, built) is None


def test_a_kernel_with_an_edited_docstring_uses_its_machine_code(built, edited):
    kernel = edited(COVER, '"""Return the number of discs', '"""Count the discs')
    assert library.find(kernel, ARRAYS, built) is not None


@pytest.fixture
def missing(tmp_path, monkeypatch):
    """A checkout: the package has no library of its own. Returns its missing folder."""
    folder = tmp_path / "checkout" / "machine_code"
    monkeypatch.setattr(library, "FOLDER", folder)
    library.library_folder.cache_clear()
    yield folder
    library.library_folder.cache_clear()


def test_a_checkout_uses_the_library_of_the_installed_package(built, missing, tmp_path, monkeypatch, edited):
    site = tmp_path / "site"
    shutil.copytree(built, site / "bokehnet/precompiled/machine_code")
    (site / "bokehnet-0.1.0.dist-info").mkdir()
    (site / "bokehnet-0.1.0.dist-info/METADATA").write_text(
        "Metadata-Version: 2.1\nName: bokehnet\nVersion: 0.1.0\n"
    )
    monkeypatch.syspath_prepend(site)
    assert library.library_folder() == site / "bokehnet/precompiled/machine_code"
    assert library.find(COVER, ARRAYS) is not None
    assert library.find(edited(COVER, "x + half + 1", "x + half + 2"), ARRAYS) is None


def test_a_checkout_without_an_installed_package_is_left_to_numba(missing, monkeypatch):
    def distribution(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "distribution", distribution)
    assert library.library_folder() == missing
    assert library.find(COVER, ARRAYS) is None


def test_an_installed_package_does_not_read_its_metadata(built, missing, monkeypatch):
    monkeypatch.setattr(library, "FOLDER", built)
    monkeypatch.setattr(metadata, "distribution", lambda name: pytest.fail("read"))
    assert library.library_folder() == built


@pytest.mark.parametrize("variable", [library.OFF, "NUMBA_DISABLE_JIT"])
def test_an_environment_variable_disables_the_library(built, monkeypatch, variable):
    monkeypatch.setenv(variable, "1")
    assert library.find(COVER, ARRAYS, built) is None


@pytest.fixture
def copies(built, tmp_path):
    """A folder with a copy of the library."""
    return Path(shutil.copytree(built, tmp_path / "copies"))


def changed(folder: Path, **changes) -> None:
    """Change entries of the manifest."""
    path = folder / "kernels.json"
    path.write_text(json.dumps(json.loads(path.read_text("utf-8")) | changes), "utf-8")


def test_a_copy_of_the_library_is_used(copies):
    assert library.find(COVER, ARRAYS, copies) is not None


@pytest.mark.parametrize(
    "changes",
    [
        {"system": "plan9-vax-32"},
        {"versions": ["CPython 3.0", "numba 0.1"]},
        {"processor": "of another kind"},
        {"format": library.FORMAT + 1},
        {"sha256": "0"},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_libraries_for_other_machines_or_versions_are_ignored(copies, changes):
    changed(copies, **changes)
    assert library.find(COVER, ARRAYS, copies) is None


def test_older_processors_go_to_the_compiler(copies, monkeypatch):
    monkeypatch.setitem(machine.CLASS_FEATURES, "of tomorrow", ("an instruction that no processor has",))
    changed(copies, processor="of tomorrow")
    assert library.find(COVER, ARRAYS, copies) is None


@pytest.mark.parametrize("name", ["kernels.bin", "kernels.json"])
@pytest.mark.parametrize("damage", [Path.unlink, lambda path: path.write_bytes(path.read_bytes()[:-2])])
def test_what_is_missing_or_damaged_is_ignored(copies, name, damage):
    damage(copies / name)
    assert library.find(COVER, ARRAYS, copies) is None


def test_a_numba_without_a_name_that_the_code_needs_goes_to_the_compiler(copies):
    """LLVM would end the process at a name that nobody defines."""
    manifest = json.loads((copies / "kernels.json").read_text("utf-8"))
    manifest["kernels"][COVER.name]["entries"][ARRAYS]["needs"].append("numba_of_another_time")
    changed(copies, kernels=manifest["kernels"])
    assert library.find(COVER, ARRAYS, copies) is None


@packed
def test_no_folder_of_the_machine_that_made_it_is_named():
    code = (library.FOLDER / "kernels.bin").read_bytes()
    assert b"/bokehnet/classical/" in code
    assert b"site-packages" not in code
    assert str(library.FOLDER.parents[1]).encode() not in code


@packed
@pytest.mark.slow
@pytest.mark.parametrize("render", [scatter, lambda image, defocus: geometric_error_map(defocus)])
def test_pictures_are_those_of_numba(render):
    """Authority: numba's compiler on the same functions. Other instructions may round otherwise.

    The other engines need a minute of compilation; their tests run with machine code and without.
    """
    image, defocus = scene()
    with record_calls():
        expected = render(image, defocus)
    assert np.abs(render(image, defocus) - expected).max() <= 1e-5 * max(1.0, np.abs(expected).max())


def called(built, kernel, *arguments):
    """Return the result of machine code that is loaded now."""
    run, flat = library.find(kernel, describe(arguments), built), []
    assert run is not None
    flatten(arguments, flat)
    return run(flat)


def test_small_kernels_give_what_numba_gives(built):
    """Authority: numba's compiler on the same functions. Other instructions may round otherwise."""
    defocus = scene()[1]
    radii = np.abs(defocus)
    for kernel, arguments in (
        (COVER, (radii,)),
        (error_map._boundary_reach, (defocus, defocus, radii, 0.5, 2)),
        (error_map._soften, (np.arange(99, dtype=np.int32).reshape(9, 11)[:, :-1], 3)),
    ):
        expected = kernel.dispatcher(*arguments)
        np.testing.assert_allclose(called(built, kernel, *arguments), expected, rtol=1e-6, atol=1e-6)


def test_every_number_of_threads_gives_the_same_result(built):
    values = np.random.default_rng(0).integers(-3, 4, (70, 90), np.int32)
    before, results = numba.get_num_threads(), []
    try:
        for threads in range(1, numba.config.NUMBA_NUM_THREADS + 1):
            numba.set_num_threads(threads)
            results.append(values.copy())
            called(built, error_map._sum_rows, results[-1])
    finally:
        numba.set_num_threads(before)
    for result in results:
        assert_array_equal(result, np.cumsum(values, 1))


def test_a_returned_array_can_be_written_and_outlives_the_kernel_that_made_it(built):
    first = called(built, COVER, np.full((40, 50), 3, np.float32))
    copy = first.copy()
    for _ in range(20):
        called(built, COVER, np.full((40, 50), 9, np.float32))
    gc.collect()
    assert_array_equal(first, copy)
    first += 1
    assert_array_equal(first, copy + 1)


def test_memory_of_a_returned_array_goes_back_once_with_its_last_view():
    selected, data = [], np.arange(6.0)

    def release(owner):
        selected.append(owner)

    structure, read = result_reader("f8[2C]", release)
    array = read(structure(5, None, 6, 8, data.ctypes.data, 2, 3, 24, 8))
    assert_array_equal(array, data.reshape(2, 3))
    view = array[1:]
    del array
    gc.collect()
    assert selected == []
    del view
    gc.collect()
    assert selected == [5]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_child_runs_kernels_after_its_parent_did(built):
    values = np.ones((70, 90), np.int32)
    called(built, error_map._sum_rows, values)
    child = os.fork()
    if child == 0:
        again = np.ones((70, 90), np.int32)
        called(built, error_map._sum_rows, again)
        os._exit(0 if np.array_equal(again, values) else 1)
    assert os.waitpid(child, 0)[1] == 0


def test_what_a_kernel_raises_is_raised(built):
    """Memory that nobody has: the kernel allocates 2^56 bytes before it reads anything."""
    flat = []
    flatten((np.zeros((1, 1), np.float32), 1, np.zeros((1, 1), np.bool_)), flat)
    flat[2], flat[5:9] = 2**56, (2**28, 2**28, 2**30, 4)
    run = library.find(_discontinuity_sides, "(f4[2C],i8,b1[2C])", built)
    assert run is not None
    with pytest.raises(MemoryError):
        run(flat)

"""Maps in NumPy files. Authority: the array that NumPy wrote."""

import io
import zipfile

import numpy as np
import pytest

from bokehnet.errors import ImageFileError
from bokehnet.io.depth.numpy_maps import read_numpy_map
from bokehnet.io.maps import read_stored_map

VALUES = np.arange(12, dtype=np.float32).reshape(3, 4) + 0.5


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "f2", "u1", "u2", "i4", "i8"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_of_numbers(tmp_path, dtype, order):
    values = np.asarray(VALUES.astype(dtype), order=order)
    np.save(tmp_path / "d.npy", values)
    stored = read_stored_map(tmp_path / "d.npy")
    assert np.array_equal(stored.numbers, values.astype(np.float32))
    assert stored.values.dtype == np.float32


@pytest.mark.parametrize("shape", [(1, 3, 4), (3, 4, 1), (1, 1, 3, 4)])
def test_axes_of_length_one_are_removed(tmp_path, shape):
    np.save(tmp_path / "d.npy", VALUES.reshape(shape))
    assert np.array_equal(read_numpy_map(tmp_path / "d.npy"), VALUES)


def test_archives(tmp_path):
    path = tmp_path / "d.npz"
    np.savez_compressed(path, image=np.zeros((3, 4, 3)), depth=VALUES)
    assert np.array_equal(read_numpy_map(path), VALUES)
    np.savez(path, left=VALUES, right=2 * VALUES)
    assert np.array_equal(read_numpy_map(path, "right"), 2 * VALUES)
    with pytest.raises(ImageFileError, match=r"expected one array, found left, right; name one"):
        read_numpy_map(path)
    with pytest.raises(ImageFileError, match=r"expected the array 'up', found left, right"):
        read_numpy_map(path, "up")


@pytest.mark.parametrize(
    "array", [np.zeros(5), np.zeros((2, 3, 4)), np.array([["a"]]), np.array([[1j]]), np.zeros((0, 3))]
)
def test_other_arrays_are_refused(tmp_path, array):
    np.save(tmp_path / "d.npy", array)
    with pytest.raises(ImageFileError, match="expected an array of numbers"):
        read_numpy_map(tmp_path / "d.npy")


def test_objects_are_never_unpickled(tmp_path):
    np.save(tmp_path / "d.npy", np.array([[{}]], object), allow_pickle=True)
    with pytest.raises(ImageFileError, match="expected an array of numbers"):
        read_numpy_map(tmp_path / "d.npy")


def test_damage_is_one_error(tmp_path):
    path = tmp_path / "d.npy"
    np.save(path, VALUES)
    whole = path.read_bytes()
    for end in (0, 4, 9, 40, 100, len(whole) - 1):
        path.write_bytes(whole[:end])
        with pytest.raises(ImageFileError):
            read_numpy_map(path)
    np.savez_compressed(tmp_path / "d.npz", depth=VALUES)
    archive = (tmp_path / "d.npz").read_bytes()
    for end in (10, len(archive) // 2, len(archive) - 1):
        path.write_bytes(archive[:end])
        with pytest.raises(ImageFileError):
            read_numpy_map(path)


def test_headers_cannot_announce_more_than_the_file_holds(tmp_path):
    buffer = io.BytesIO()
    header = {"descr": "<f8", "fortran_order": False, "shape": (7000, 7000)}
    np.lib.format.write_array_header_1_0(buffer, header)
    (tmp_path / "d.npy").write_bytes(buffer.getvalue())
    with pytest.raises(ImageFileError, match=r"truncated|more than the limit"):
        read_numpy_map(tmp_path / "d.npy")
    with zipfile.ZipFile(tmp_path / "d.npz", "w") as archive:
        archive.writestr("depth.npy", buffer.getvalue())
    with pytest.raises(ImageFileError, match=r"truncated|more than the limit"):
        read_numpy_map(tmp_path / "d.npz")


def test_a_header_that_python_cannot_parse_is_one_error(tmp_path):
    """A fuzzed shape ended in ``tokenize.TokenError``."""
    np.save(tmp_path / "d.npy", VALUES)
    data = (tmp_path / "d.npy").read_bytes()
    end = data.index(b"(") + 2
    (tmp_path / "d.npy").write_bytes(data[:end] + b"\x7f\0\0" + b" " * 10 + data[end + 13 :])
    with pytest.raises(ImageFileError, match="expected a NumPy array"):
        read_numpy_map(tmp_path / "d.npy")

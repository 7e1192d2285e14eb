"""Stored transfer functions against the lens that they were made of."""

import numpy as np
import pytest

from bokehnet.errors import LensError
from bokehnet.lenses import TransferLens, load_lens
from bokehnet.lenses.catalog import find_prescription
from bokehnet.lenses.lookup.transfer_file import read_transfer, transfer_errors, write_transfer


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    lens = TransferLens(prescription=find_prescription("petzval"))
    path = tmp_path_factory.mktemp("transfer") / "petzval.npz"
    write_transfer(lens, path)
    return lens, path


def test_a_stored_table_gives_the_same_rays(stored):
    lens, path = stored
    result = load_lens(path, f_number=4.0, focus_distance=3000.0)
    assert isinstance(result, TransferLens)
    assert (result.f_number, result.focus_distance) == (4.0, 3000.0)
    assert result.prescription == lens.prescription
    np.testing.assert_array_equal(result.table.coefficients, lens.table.coefficients)
    actual = TransferLens(prescription=lens.prescription, f_number=4.0, focus_distance=3000.0)
    place, pupil = np.array([[5.0, 3.0]]), np.array([[0.3, -0.4]])
    one, two = (each.sample_rays(place, pupil) for each in (result, actual))
    np.testing.assert_array_equal(one.slope, two.slope)


def test_errors_are_listed_by_zone(stored):
    """Authority: traced rays, as in ``test_transfer.py``, with its bound of 0.1 micrometres."""
    rows = transfer_errors(stored[0])
    assert [row.zone for row in rows] == [(0.0, 0.4), (0.4, 0.7), (0.7, 1.0)]
    assert all(0 < row.rms <= row.largest < 0.1 for row in rows)
    assert all(row.disagreement < 5e-4 for row in rows)
    coarse = transfer_errors(TransferLens(prescription=stored[0].prescription, degree=2))
    assert coarse[0].rms > 10 * rows[0].rms


def test_a_table_is_of_one_focal_length(stored):
    with pytest.raises(LensError, match="a transfer table has one focal length"):
        load_lens(stored[1], focal_length=50.0)


def test_what_is_no_table_is_refused(stored, tmp_path):
    with pytest.raises(LensError, match=r"cannot read .*none\.npz: No such file"):
        read_transfer(tmp_path / "none.npz")
    broken = tmp_path / "broken.npz"
    broken.write_bytes(stored[1].read_bytes()[:400])
    with pytest.raises(LensError, match="expected a lens ray transfer function"):
        read_transfer(broken)
    np.savez(broken, kind="a picture")
    with pytest.raises(LensError, match="found 'a picture'"):
        read_transfer(broken)
    with np.load(stored[1]) as file:
        parts = dict(file)
    np.savez(broken, **{**parts, "coefficients": parts["coefficients"][:, :3]})
    with pytest.raises(LensError, match="coefficients: expected 35 columns for degree 4"):
        read_transfer(broken)
    np.savez(broken, **{**parts, "prescription": "name = 3"})
    with pytest.raises(LensError, match="prescription"):
        read_transfer(broken)

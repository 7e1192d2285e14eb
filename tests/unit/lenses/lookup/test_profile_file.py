"""Profile textures in files: as they were written, and refused where they are not."""

import numpy as np
import pytest

from bokehnet.errors import LensError
from bokehnet.lenses import load_lens
from bokehnet.lenses.lookup.profile_file import read_profile, write_profile
from bokehnet.lenses.lookup.profile_texture import profile_row, trace_profile_texture
from bokehnet.lenses.lookup.transfer_file import read_transfer


@pytest.fixture(scope="module")
def made():
    lens = load_lens("petzval", f_number=4.0, focus_distance=3000.0, focusing="paraxial")
    return lens, trace_profile_texture(lens, rows=9, columns=16)


def test_a_texture_is_read_as_it_was_written(made, tmp_path):
    lens, texture = made
    path = tmp_path / "profile.npz"
    write_profile(texture, lens, path)
    result, own = read_profile(path)
    assert own == lens
    for name in ("planes", "reach", "light"):
        np.testing.assert_array_equal(getattr(result, name), getattr(texture, name))
    assert profile_row(result, own, 2000.0, 450.0) == profile_row(texture, lens, 2000.0, 450.0)
    with pytest.raises(LensError, match="expected a lens ray transfer function"):
        read_transfer(path)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("kind", "photograph", "expected a lens profile texture 1, found 'photograph'"),
        ("planes", np.zeros(9), "planes: expected distances that rise"),
        ("planes", np.arange(8.0), "planes, reach, light: expected rows of one number"),
        ("light", np.full((9, 16), np.nan), "expected finite numbers"),
        ("reach", np.zeros(9), "radii above 0"),
        ("focusing", "soft", "focusing: expected sharpest or paraxial"),
        ("f_number", "fast", "expected a lens profile texture 1, found damage"),
        ("prescription", "name = 3", "prescription"),
    ],
)
def test_what_is_no_texture_is_one_line(made, tmp_path, name, value, words):
    lens, texture = made
    path = tmp_path / "profile.npz"
    write_profile(texture, lens, path)
    with np.load(path) as file:
        held = dict(file)
    held[name] = value
    np.savez(path, **held)
    with pytest.raises(LensError, match=words) as caught:
        read_profile(path)
    assert "\n" not in str(caught.value)


def test_a_missing_and_a_cut_file_are_one_line(made, tmp_path):
    lens, texture = made
    path = tmp_path / "profile.npz"
    with pytest.raises(LensError, match=r"cannot read .*profile\.npz: No such file"):
        read_profile(path)
    write_profile(texture, lens, path)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(LensError, match="expected a lens profile texture 1, found damage"):
        read_profile(path)

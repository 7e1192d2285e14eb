"""Aberration maps on disk."""

import dataclasses
import os

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.lenses import load_lens
from bokehnet.lenses.aberrations import aberration_cache
from bokehnet.lenses.aberrations.aberration_cache import cache_folder, cached_aberration_map
from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map

LENS = load_lens("double_gauss", focus_distance=3000.0)


@pytest.fixture
def fits(monkeypatch):
    """Lenses that were traced, in turn."""
    traced = []

    def fit(lens, **settings):
        traced.append(lens)
        return fit_aberration_map(lens, **settings)

    monkeypatch.setattr(aberration_cache, "fit_aberration_map", fit)
    return traced


def assert_same(first, second):
    for name in ("wavelengths", "transverse_aberration", "pupil_aberration"):
        assert_array_equal(getattr(first, name), getattr(second, name))
    assert first.vignetting_apertures == second.vignetting_apertures


@pytest.mark.slow
def test_a_map_is_traced_once_and_read_back_bit_for_bit(tmp_path, fits):
    first = cached_aberration_map(LENS, wavelengths=(500.0,), folder=tmp_path / "new")
    second = cached_aberration_map(LENS, wavelengths=(500.0,), folder=tmp_path / "new")
    assert len(fits) == 1
    assert first.vignetting_apertures
    assert_same(first, second)
    assert_same(first, fit_aberration_map(LENS, wavelengths=(500.0,)))
    assert [path.suffix for path in (tmp_path / "new").iterdir()] == [".npz"]


@pytest.mark.slow
def test_everything_that_matters_makes_another_map(tmp_path, fits):
    def change(row):
        design = LENS.prescription
        surfaces = (dataclasses.replace(design.surfaces[0], **row), *design.surfaces[1:])
        return dataclasses.replace(LENS, prescription=dataclasses.replace(design, surfaces=surfaces))

    settings = {"wavelengths": (), "folder": tmp_path}
    cached_aberration_map(LENS, **settings)
    cached_aberration_map(dataclasses.replace(LENS, f_number=4.0), **settings)
    cached_aberration_map(dataclasses.replace(LENS, focus_distance=3001.0), **settings)
    cached_aberration_map(change({"thickness": 7.53}), **settings)
    cached_aberration_map(change({"abbe": (1.67, 47.2)}), **settings)
    cached_aberration_map(LENS, half_diagonal=30.0, **settings)
    cached_aberration_map(LENS, distortion=True, **settings)
    cached_aberration_map(LENS, wavelengths=(500.0,), folder=tmp_path)
    assert len(fits) == 8
    # What names the same setting does not.
    cached_aberration_map(dataclasses.replace(LENS, f_number=LENS.min_f_number), **settings)
    cached_aberration_map(LENS, half_diagonal=LENS.prescription.image_radius, **settings)
    assert len(fits) == 8


@pytest.mark.parametrize("harm", ["empty", "cut", "noise", "foreign", "other lens", "wrong shape"])
def test_a_damaged_or_foreign_file_is_replaced(tmp_path, fits, harm):
    expected = cached_aberration_map(LENS, wavelengths=(), folder=tmp_path)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    with np.load(path) as file:
        arrays = dict(file)
    if harm == "empty":
        path.write_bytes(b"")
    elif harm == "cut":
        path.write_bytes(whole[: len(whole) // 2])
    elif harm == "noise":
        path.write_bytes(np.random.default_rng(0).bytes(500))
    elif harm == "foreign":
        np.savez(path, something=np.zeros(3))
    elif harm == "other lens":
        np.savez(path, **arrays | {"key": np.array("another")})
    else:
        np.savez(path, **arrays | {"transverse_aberration": arrays["transverse_aberration"][..., :4]})
    assert_same(cached_aberration_map(LENS, wavelengths=(), folder=tmp_path), expected)
    assert len(fits) == 2
    cached_aberration_map(LENS, wavelengths=(), folder=tmp_path)
    assert len(fits) == 2


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path, fits):
    (tmp_path / "file").write_text("in the way")
    for _ in range(2):
        cached_aberration_map(LENS, wavelengths=(), folder=tmp_path / "file")
    assert len(fits) == 2
    assert (tmp_path / "file").read_text() == "in the way"


def test_a_write_that_fails_leaves_nothing_behind(tmp_path, fits, monkeypatch):
    def fail(*_):
        raise OSError("disk full")

    with monkeypatch.context() as broken:
        broken.setattr(os, "replace", fail)
        cached_aberration_map(LENS, wavelengths=(), folder=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_the_folder_is_that_of_the_xdg_specification(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "bokehnet"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder() == tmp_path / "home" / ".cache" / "bokehnet"

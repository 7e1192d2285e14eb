"""Profile textures against rays traced through the glass, and against Gaussian optics."""

import numpy as np
import pytest

from bokehnet.lenses import load_lens
from bokehnet.lenses.aberrations.point_spread import PsfGrid, correlation, traced_psf
from bokehnet.lenses.lookup.profile_texture import profile_psf, profile_row, trace_profile_texture


def test_a_row_holds_all_light_of_a_disc():
    texture = trace_profile_texture(load_lens("petzval", focus_distance=3000.0), rows=9, columns=32)
    middles = (np.arange(32) + 0.5) / 32
    assert (texture.light * 2 * middles / 32).sum(axis=1) == pytest.approx(np.ones(9), rel=1e-5)


@pytest.mark.parametrize("depth", [1500.0, 2500.0, 9000.0])
def test_rows_are_chosen_as_gaussian_optics_blurs(depth):
    """Stopped far down the reach of the row is the circle of confusion."""
    lens = load_lens("double_gauss", f_number=32.0, focus_distance=3000.0)
    texture = trace_profile_texture(lens, rows=201)
    row = profile_row(texture, lens, depth)
    reach = np.interp(row, texture.planes, texture.reach)
    assert reach == pytest.approx(abs(float(lens.coc_radius(1 / depth))), rel=0.02)


def _both(lens, texture, depth, wavelength, value):
    """Blur as traced, and by the row of a given wavelength."""
    color, pitch = np.ones((1, 1)), 0.03
    traced = traced_psf(
        lens,
        PsfGrid(wavelengths=np.array([wavelength]), colors=color, pitch=pitch, size=64, rays=40000),
        depth=depth,
        field=(0.0, 0.0),
    )
    row = profile_row(texture, lens, depth, value)
    return traced, profile_psf(texture, np.array([row]), color, pitch, 64)


def test_blur_on_the_axis_is_that_of_traced_rays():
    """Of a lens with spherical aberration, in front of its focus and behind."""
    lens = load_lens("petzval", focus_distance=3000.0)
    texture = trace_profile_texture(lens)
    for depth in (1500.0, 9000.0):
        traced, shown = _both(lens, texture, depth, lens.prescription.design_wavelength, None)
        assert shown.sum() == pytest.approx(1, rel=0.01)
        assert correlation(traced, shown) > 0.99


def test_another_colour_is_another_row():
    lens = load_lens("petzval", focus_distance=3000.0)
    texture = trace_profile_texture(lens)
    traced, moved = _both(lens, texture, 9000.0, 450.0, 450.0)
    _, still = _both(lens, texture, 9000.0, 450.0, None)
    assert correlation(traced, moved) > correlation(traced, still) + 0.1

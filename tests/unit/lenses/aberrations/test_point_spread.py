"""Point-spread functions, traced and reduced."""

import math

import numpy as np
import pytest

from bokehnet.errors import LensError, ParameterError, ShapeError
from bokehnet.lenses import load_lens
from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.point_spread import (
    PsfGrid,
    aberration_psf,
    correlation,
    psf_radius,
    traced_psf,
)
from bokehnet.lenses.aberrations.psf_pairs import psf_depths, psf_pairs
from bokehnet.optics.aberrations.aberration_map import AberrationMap

GREEN = {"wavelengths": np.array([587.56]), "colors": np.ones((1, 1))}


def moments(psf, pitch):
    """Middle (2,) and mean square distance from it, of light (N, N, C); ``pitch`` is a cell's side."""
    light = psf.sum(-1) / psf.sum()
    places = pitch * (np.arange(len(psf)) + 0.5 - len(psf) / 2)
    x, y = (light * places).sum(), (light * places[:, None]).sum()
    square = light * ((places - x) ** 2 + (places[:, None] - y) ** 2)
    return np.array([x, y]), square.sum()


@pytest.mark.slow
@pytest.mark.parametrize("depth", [1500.0, 2200.0, 9000.0])
@pytest.mark.parametrize("field", [(0.0, 0.0), (0.15, -0.1)])
def test_stopped_down_blur_is_a_disc_of_the_paraxial_radius(depth, field):
    """Reference: Gauss; an even disc of radius r has a mean square of r^2 / 2. Traced and reduced both."""
    lens = load_lens("double_gauss", f_number=16.0, focus_distance=3000.0)
    half_diagonal = lens.prescription.image_radius
    radius = float(lens.coc_radius(1 / depth))
    pitch = abs(radius) / 20
    traced = traced_psf(lens, PsfGrid(pitch=pitch, size=60, **GREEN), depth=depth, field=field)
    reduced = aberration_psf(
        fit_aberration_map(lens, wavelengths=()),
        PsfGrid(pitch=pitch / half_diagonal, size=60, **GREEN),
        defocus=radius / half_diagonal,
        field=field,
    )
    for psf in (traced, reduced):
        middle, square = moments(psf, pitch)
        # The lens itself: its distortion and field curvature change the radius by some per cent off the axis.
        assert math.sqrt(2 * square) == pytest.approx(abs(radius), rel=0.02 if field == (0.0, 0.0) else 0.04)
        assert np.abs(middle).max() < 0.03 * abs(radius)
        assert psf.sum() == pytest.approx(1, abs=1e-9)
    assert correlation(traced, reduced) > 0.99


def test_the_perfect_map_gives_a_disc():
    """Reference: pi r^2 cells, evenly lit."""
    psf = aberration_psf(
        AberrationMap.perfect(), PsfGrid(pitch=0.001, size=50, **GREEN), defocus=0.02, field=(0.4, 0.3)
    )
    lit = psf[..., 0] > 0.5 / (math.pi * 20**2)
    assert lit.sum() == pytest.approx(math.pi * 20**2, rel=0.02)
    assert psf[20:30, 20:30].mean() * math.pi * 20**2 == pytest.approx(1, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["double_gauss", "retrofocus"])
def test_reduced_and_traced_agree_over_depth_and_field(name):
    """Reference: light sent through the glass; wide open, in colour. The required mean is 0.95."""
    lens = load_lens(name, focus_distance=30 * load_lens(name).focal_length)
    pairs = list(psf_pairs(lens, rays=4000))
    result = np.array([pair.correlation for pair in pairs])
    assert len(result) == 9
    assert result.mean() > 0.97
    assert result.min() > 0.93
    # They are no perfect discs, which would be enough otherwise.
    corner = pairs[2]
    disc = aberration_psf(
        AberrationMap.perfect(),
        PsfGrid(pitch=corner.width / len(corner.traced), size=len(corner.traced), **GREEN),
        defocus=corner.blur_radius,
        field=(corner.field, 0.0),
    )
    assert correlation(corner.traced.mean(-1), disc[..., 0]) < corner.correlation - 0.01


def test_light_lost_at_the_rims_is_missing_from_both():
    """The full disc falls to less than half in the corner of the Double Gauss."""
    lens = load_lens("double_gauss", focus_distance=3000.0)
    middle, corner = (psf_radius(lens, 1500.0, (distance, 0.0)) for distance in (0.0, 0.9))
    assert corner == pytest.approx(middle, rel=0.15)  # across, nothing is lost
    pitch = 2.2 * middle / 64
    narrow = traced_psf(lens, PsfGrid(pitch=pitch, size=64, **GREEN), depth=1500.0, field=(0.9, 0.0))[..., 0]
    across, along = (
        (narrow > 0.2 * narrow.max()).any(axis=1).sum(),
        (narrow > 0.2 * narrow.max()).any(axis=0).sum(),
    )
    assert along < 0.5 * across


@pytest.mark.parametrize("focus", [math.inf, 3000.0, 400.0])
@pytest.mark.parametrize("name", ["biconvex", "retrofocus"])
def test_depths_enclose_the_focus(name, focus):
    lens = load_lens(name, focus_distance=focus)
    near, middle, far = psf_depths(lens)
    assert lens.front_vertex < near < middle < far < math.inf
    if math.isfinite(focus):
        assert middle == pytest.approx(focus)


def test_mistakes_are_reported():
    lens = load_lens("petzval", focus_distance=3000.0)
    grid = {"pitch": 0.01, "size": 8} | GREEN
    for far in (3.0, 30.0):
        with pytest.raises(LensError, match="no ray through the middle"):
            traced_psf(lens, PsfGrid(**grid), depth=2000.0, field=(far, 0.0))
    with pytest.raises(ParameterError, match="pitch"):
        PsfGrid(**grid | {"pitch": 0.0})
    with pytest.raises(ShapeError, match="colors"):
        PsfGrid(**grid | {"wavelengths": np.array([500.0, 600.0]), "colors": np.ones((1, 3))})
    with pytest.raises(ParameterError, match="defocus"):
        aberration_psf(
            AberrationMap.perfect(), PsfGrid(pitch=0.01, size=8, **GREEN), defocus=math.nan, field=(0, 0)
        )

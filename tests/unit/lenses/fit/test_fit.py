"""Looks fitted to discs of known ones; least squares against closed forms."""

import numpy as np
import pytest

from bokehnet.errors import LensError
from bokehnet.lenses.fit.disc_model import Look, draw_disc, edge_depth
from bokehnet.lenses.fit.discs import Disc, find_discs
from bokehnet.lenses.fit.fit import fit_look
from bokehnet.lenses.fit.least_squares import solve
from bokehnet.optics.aperture import Aperture, transmission

SIZE = (220, 150)
PLACES = [(50.0, 45.5), (165.0, 50.0), (60.5, 110.0)]


def test_least_squares_finds_what_the_normal_equations_give_and_its_spread():
    rng = np.random.default_rng(0)
    matrix, truth = rng.normal(size=(500, 3)), np.array([1.0, -2.0, 3.0])
    expected = matrix @ truth + 0.1 * rng.normal(size=500)
    bounds = np.full(3, -10.0), np.full(3, 10.0)
    result = solve(lambda v: matrix @ v - expected, lambda v, r: matrix, np.zeros(3), *bounds, 50)
    np.testing.assert_allclose(result.values, np.linalg.lstsq(matrix, expected, rcond=None)[0], atol=1e-5)
    spread = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)) * result.cost / 497)
    np.testing.assert_allclose(result.deviation, spread, rtol=1e-6)


def test_least_squares_stays_within_bounds():
    result = solve(
        lambda v: v - np.array([5.0, 0.5]), lambda v, r: np.eye(2), np.zeros(2), np.zeros(2), np.ones(2), 20
    )
    np.testing.assert_allclose(result.values, [1.0, 0.5], atol=1e-4)


@pytest.mark.parametrize("blades", [0, 6])
def test_the_smooth_disc_is_the_opening(blades):
    """Authority: ``transmission``, averaged over pixels."""
    look = Look(blades=blades, curvature=0.2, rotation=10.0, spherical_profile=0.4, softness=0.05)
    aperture = Aperture(blades=blades, curvature=0.2, rotation=10.0, spherical_profile=0.4)
    y, x = np.mgrid[:81, :81].astype(float)
    fine = (np.arange(81 * 8) + 0.5) / 8 - 0.5
    u, v = np.meshgrid((fine - 40) / -30, (fine - 40) / -30)
    expected = transmission(aperture, u, v, -1).reshape(81, 8, 81, 8).mean((1, 3))
    result = draw_disc(look, x, y, (40.0, 40.0), -30.0, (81, 81))
    assert np.abs(result - expected).max() < 0.35  # at a rim's pixel
    assert np.sqrt(np.mean((result - expected) ** 2)) < 0.02


def test_straight_edges_are_a_cosine_from_the_centre():
    assert edge_depth(6, 0.0) == pytest.approx(1 - np.cos(np.pi / 6))
    assert edge_depth(6, 1.0) == pytest.approx(0, abs=1e-9)
    assert edge_depth(6, 0.3) > edge_depth(6, 0.6) > 0


def test_invisible_blades_are_a_round_aperture():
    """Edges bent to within 0.03 pixels of the circle: 22 (1 - cos 30 deg) is 2.9 when they are straight."""
    truth = Look(blades=6, curvature=0.995, rotation=12.0, softness=0.6)
    assert 22 * edge_depth(6, 0.995) < 0.03
    image = picture(truth, noise=0.0)
    result = fit_look(image, find_discs(image[..., 1]), blades=(0, 6))
    assert result.look.blades == 0
    assert "curvature" not in result.deviation
    forced = fit_look(image, find_discs(image[..., 1]), blades=(6,))
    assert set(forced.residual_by_blades) == {6}


def picture(look, radius=-22.0, noise=0.004):
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
    image = np.full((SIZE[1], SIZE[0], 3), 0.02)
    for number, place in enumerate(PLACES):
        disc = draw_disc(look, x, y, place, radius, SIZE)
        image += disc[..., None] * np.array([0.5, 0.4, 0.3]) * (1 - 0.2 * number)
    return image + np.random.default_rng(0).normal(size=image.shape) * noise


def test_lamps_are_found_where_they_are():
    result = sorted(find_discs(picture(Look(blades=6))[..., 1]), key=lambda disc: (disc.y > 80, disc.x))
    assert [(disc.x, disc.y) for disc in result] == [pytest.approx(place, abs=2) for place in PLACES]
    assert [disc.radius for disc in result] == pytest.approx([22] * 3, abs=2)
    assert find_discs(np.zeros((50, 50))) == []


def test_a_look_is_found_again_with_its_doubt():
    truth = Look(blades=6, curvature=0.3, rotation=12.0, spherical_profile=-0.3, cats_eye=0.5, softness=0.6)
    image = picture(truth)
    result = fit_look(image, find_discs(image[..., 1]))
    assert result.look.blades == 6
    for name, apart in (
        ("curvature", 0.05),
        ("rotation", 3),
        ("spherical_profile", 0.1),
        ("cats_eye", 0.075),
    ):
        error = abs(getattr(result.look, name) - getattr(truth, name))
        assert error < apart
        assert error < 6 * result.deviation[name] < 6 * apart
    assert result.residual < 0.05
    assert result.residual_by_blades[6] == min(result.residual_by_blades.values())


def test_no_lamp_and_only_clipped_ones_are_refused():
    image = np.zeros((60, 60, 3))
    with pytest.raises(LensError, match="lights: expected at least one isolated blurred lamp"):
        fit_look(image, [])
    with pytest.raises(LensError, match=r"expected light below white .* found it clipped"):
        fit_look(image + 1, [Disc(x=30, y=30, radius=10)])


@pytest.mark.parametrize(("lamps", "radius"), [(3, -22.0), (1, -34.0)])
def test_a_round_opening_gets_no_blades_from_correlated_noise(lamps, radius):
    """Noise several pixels wide, as JPEG leaves it: it looks like blades on the lamps fitted to."""
    rng = np.random.default_rng(5)
    image = picture(Look(cats_eye=0.3, softness=0.6), radius, noise=0.0)
    coarse = np.kron(rng.normal(size=(50, 74, 3)), np.ones((3, 3, 1)))[: SIZE[1], : SIZE[0]]
    image = image + 0.02 * coarse
    discs = [Disc(x=x, y=y, radius=abs(radius)) for x, y in PLACES[:lamps]]
    result = fit_look(image, discs, blades=(0, 5, 8))
    assert result.look.blades == 0
    residual = result.residual_by_blades
    assert residual[5] < residual[0]  # blades do reduce the residual of the discs that they are fitted to


@pytest.mark.parametrize("lamps", [1, 3])
def test_shallow_blades_are_found_on_lamps_that_they_were_not_fitted_to(lamps):
    """Edges half a pixel within the circle."""
    truth = Look(blades=6, curvature=0.8, rotation=12.0, cats_eye=0.3, softness=0.6)
    assert 0.4 < 22 * edge_depth(6, 0.8) < 0.7
    image = picture(truth)
    discs = [Disc(x=x, y=y, radius=22.0) for x, y in PLACES[:lamps]]
    assert fit_look(image, discs, blades=(0, 5, 6)).look.blades == 6

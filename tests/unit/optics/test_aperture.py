"""The lens opening against what is known of its parts."""

import math

import numpy as np
import pytest
from numba import njit
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ParameterError, ShapeError
from bokehnet.optics.aperture import Aperture, cats_eye_shift, pupil_points, transmission
from bokehnet.optics.sampling import halton

AXIS = (np.arange(1000) + 0.5) / 500 - 1
U, V = np.meshgrid(AXIS, AXIS)
CELL = (2 / 1000) ** 2

LETTER = np.array([[1, 1, 1], [1, 0, 0], [1, 1, 0], [1, 0, 0], [1, 0, 0]])

SHAPES = {
    "disc": Aperture(),
    "blades": Aperture(blades=5, curvature=0.3, rotation=10),
    "oval ring": Aperture(squeeze=0.5, obstruction=0.4, spherical_profile=0.5),
    "wide": Aperture(squeeze=1.7, blades=7),
    "letter": Aperture(picture=LETTER, spherical_profile=-0.4),
    "bright rim": Aperture(spherical_profile=1.0),
    "onion": Aperture(onion=1.0, onion_rings=2.5, grain=0.5),
    "onion blades": Aperture(onion=0.5, blades=6, grain=1.0, grain_seed=3),
}


def square(count: int) -> np.ndarray:
    return np.stack([halton(count, 2), halton(count, 3)], -1)


@pytest.mark.parametrize("blades", [3, 4, 5, 9, 16])
def test_straight_blades_have_the_area_of_a_regular_polygon(blades):
    """Area of a regular n-gon in the unit circle: n / 2 sin(2 pi / n)."""
    area = transmission(Aperture(blades=blades, rotation=7), U, V).sum() * CELL
    assert area == pytest.approx(blades / 2 * math.sin(2 * math.pi / blades), rel=2e-3)


@pytest.mark.parametrize("curvature", [0.01, 0.4, 0.9])
def test_curved_blades_are_arcs_through_the_corners(curvature):
    """An arc of curvature c over a chord of half-length h rises (1 - sqrt(1 - c^2 h^2)) / c above it."""
    blades = 6
    half = math.sin(math.pi / blades)
    middle = math.cos(math.pi / blades) + (1 - math.sqrt(1 - (curvature * half) ** 2)) / curvature
    aperture = Aperture(blades=blades, curvature=curvature)
    for angle, radius in [(math.pi / blades, 1.0), (0, middle), (2 * math.pi / blades, middle)]:
        direction = -math.cos(angle), math.sin(angle)
        for factor, light in [(0.999, 1), (1.001, 0)]:
            assert transmission(aperture, *(factor * radius * np.array(direction))) == light


def test_blades_of_curvature_one_are_the_disc():
    assert_array_equal(transmission(Aperture(blades=7, curvature=1.0), U, V), U**2 + V**2 <= 1)
    assert Aperture(blades=7, curvature=1.0).is_disc
    assert not Aperture(blades=7).is_disc


def test_rotation_is_counter_clockwise_as_seen():
    """A triangle's corner on the right, at (1, 0), goes up: (cos, -sin) of the angle."""
    for angle in (20.0, 90.0):
        corner = 0.99 * np.array([math.cos(math.radians(angle)), -math.sin(math.radians(angle))])
        assert transmission(Aperture(blades=3, rotation=angle), *corner) == 1
        assert transmission(Aperture(blades=3, rotation=-angle), *corner) == 0


@pytest.mark.parametrize("squeeze", [0.4, 1.0, 2.5])
def test_squeeze_is_width_over_height_and_the_longer_axis_stays(squeeze):
    lit = transmission(Aperture(squeeze=squeeze), U, V) > 0
    width, height = U[lit].max(), V[lit].max()
    assert width / height == pytest.approx(squeeze, rel=0.01)
    assert max(width, height) == pytest.approx(1, abs=0.003)


@pytest.mark.parametrize("rim", [-1.0, 0.3, 1.0])
def test_rim_moves_light_but_keeps_it(rim):
    """The mean of 2 rho^2 - 1 over the unit disc is 0; behind focus it is added, in front taken off."""
    behind, front = (transmission(Aperture(spherical_profile=rim), U, V, side) for side in (-1, 1))
    assert behind.sum() * CELL == pytest.approx(math.pi, rel=1e-3)
    assert front.sum() * CELL == pytest.approx(math.pi, rel=1e-3)
    assert_allclose(behind + front, 2 * transmission(Aperture(spherical_profile=rim), U, V), atol=1e-12)
    assert transmission(Aperture(spherical_profile=rim), 0.0, 0.999, -1) == pytest.approx(1 + rim, abs=0.005)


@pytest.mark.parametrize("rings", [1.0, 2.3, 12.0, 40.0])
def test_onion_rings_move_light_but_keep_it(rings):
    """Bright rings behind focus are dark in front, and on both sides the disc's energy is that of pi."""
    aperture = Aperture(onion=0.7, onion_rings=rings)
    behind, front = (transmission(aperture, U, V, side) for side in (-1, 1))
    assert behind.min() >= 0
    assert behind.sum() * CELL == pytest.approx(math.pi, rel=2e-3)
    assert_allclose(behind + front, 2 * transmission(Aperture(), U, V), atol=1e-12)


def test_onion_has_as_many_rings_as_are_requested():
    """Between the middle and the rim a cosine of n periods has its minima at (k - 1/2) / n."""
    rho = np.linspace(0, 1, 2001)
    light = transmission(Aperture(onion=1.0, onion_rings=5), rho, 0 * rho, -1)
    minima = rho[1:-1][(light[1:-1] < light[:-2]) & (light[1:-1] < light[2:])]
    assert_allclose(minima, (np.arange(5) + 0.5) / 5, atol=1e-3)


def test_grain_is_the_same_on_both_sides_and_differs_with_the_seed():
    first, second = (
        transmission(Aperture(grain=0.6, grain_seed=seed), U, V, 1)[U**2 + V**2 < 1] - 1 for seed in (0, 1)
    )
    assert_array_equal(transmission(Aperture(grain=0.6), U, V, -1)[U**2 + V**2 < 1] - 1, first)
    assert abs(first).max() <= 0.6
    assert 0.05 < first.std() < 0.3
    assert abs(first.mean()) < 0.05
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.1


def test_grain_has_no_jumps():
    """Steps shrink with the distance: 1 / 500 of the pupil apart, the lattice of 48 cells moves little."""
    light = transmission(Aperture(grain=1.0), U[:, 400:600], V[:, 400:600])[100:900]
    assert abs(np.diff(light, axis=1)).max() < 0.2
    half = transmission(Aperture(grain=0.5), U[:, 400:600], V[:, 400:600])[100:900]
    assert_allclose(half - 1, 0.5 * (light - 1), atol=1e-12)


def test_without_strength_rings_and_seed_change_nothing():
    plain, idle = (
        Aperture(spherical_profile=0.3),
        Aperture(spherical_profile=0.3, onion_rings=5, grain_seed=9),
    )
    assert plain == idle
    assert Aperture(onion_rings=5, grain_seed=9).is_disc
    assert not Aperture(onion=0.01).is_disc
    assert not Aperture(grain=0.01).is_disc
    for side in (1, -1):
        assert_array_equal(transmission(idle, U, V, side), transmission(plain, U, V, side))


def test_obstruction_cuts_its_disc_out():
    """Area of a ring: pi (1 - o^2)."""
    area = transmission(Aperture(obstruction=0.6), U, V).sum() * CELL
    assert area == pytest.approx(math.pi * (1 - 0.36), rel=1e-3)


def test_picture_is_that_of_the_pupil_and_its_longer_side_spans_it():
    """Light through A falls at -d A, so at aperture coordinates a the picture is that of -a."""
    aperture = Aperture(picture=LETTER)
    for row in range(5):
        for column in range(3):
            u, v = (2 * column + 1 - 3) / 5, (2 * row + 1 - 5) / 5
            if math.hypot(u, v) < 1:
                assert transmission(aperture, -u, -v) == LETTER[row, column]
    assert transmission(aperture, 0.62, 0.0) == 0
    assert transmission(aperture, 0.4, -0.99) == 0


def test_parts_of_the_opening_multiply():
    picture = np.linspace(0.2, 1, 30).reshape(5, 6)
    product = transmission(Aperture(picture=picture), U, V) * transmission(Aperture(blades=5), U, V)
    product *= transmission(Aperture(obstruction=0.3, spherical_profile=0.5), U, V, -1)
    both = Aperture(picture=picture, blades=5, obstruction=0.3, spherical_profile=0.5)
    assert_allclose(transmission(both, U, V, -1), product)


def test_second_pupil_moves_outwards_with_the_distance_from_the_centre():
    """0 in the centre, the given length at the picture's corner, along the line to it."""
    assert cats_eye_shift(0.8, 149.5, 99.5, 300, 200) == (0, 0)
    u, v = cats_eye_shift(0.8, 299.5, 199.5, 300, 200)
    assert math.hypot(u, v) == pytest.approx(0.8)
    assert u / v == pytest.approx(300 / 200)
    assert u > 0
    half_u, half_v = cats_eye_shift(0.8, 224.5, 149.5, 300, 200)
    assert_allclose([half_u, half_v], [u / 2, v / 2])
    compiled = njit(lambda: cats_eye_shift(0.8, 224.5, 149.5, 300, 200))
    assert_allclose(compiled(), [half_u, half_v])


def test_openings_are_equal_by_value():
    first, second = (Aperture(blades=6, picture=LETTER) for _ in range(2))
    assert first == second
    assert hash(first) == hash(second)
    assert first != Aperture(blades=6, picture=1 - LETTER)
    assert first != Aperture(blades=6)
    assert Aperture(cats_eye=0.5) != Aperture()


def test_picture_is_a_read_only_copy():
    picture = np.ones((3, 3))
    aperture = Aperture(picture=picture)
    picture[:] = 0
    assert transmission(aperture, 0.0, 0.0) == 1
    with pytest.raises(ValueError, match="read-only"):
        aperture.picture[0, 0] = 0


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("name", SHAPES)
def test_pupil_points_follow_the_light(name, side):
    """Authority: moments of the transmission on a fine grid. Random points would miss by about 0.01."""
    aperture = SHAPES[name]
    points, weights = pupil_points(aperture, square(4096), side)
    light = transmission(aperture, U, V, side)
    for p, q in [(1, 0), (0, 1), (2, 0), (0, 2), (1, 1), (3, 0)]:
        expected = (light * U**p * V**q).sum() / light.sum()
        measured = (weights * points[:, 0] ** p * points[:, 1] ** q).sum() / weights.sum()
        assert measured == pytest.approx(expected, abs=3e-3)


@pytest.mark.parametrize("name", SHAPES)
def test_pupil_points_carry_light_only_inside_the_opening(name):
    points, weights = pupil_points(SHAPES[name], square(2000), 1)
    assert weights.min() >= 0
    lit = transmission(SHAPES[name], points[:, 0], points[:, 1]) > 0
    assert not weights[~lit].any()
    assert (weights > 0).mean() > 0.97


def test_strata_of_the_square_stay_strata():
    """With the points' v in 8 equal strata of the square, each eighth of the light gets an eighth."""
    aperture = Aperture(blades=3)
    grid = (np.arange(64) + 0.5) / 64
    points, _ = pupil_points(aperture, np.stack(np.meshgrid(grid, grid), -1).reshape(-1, 2), 1)
    light = transmission(aperture, U, V).sum(axis=1).cumsum()
    edges = AXIS[np.searchsorted(light / light[-1], np.arange(1, 8) / 8)]
    counts = np.histogram(points[:, 1], [-1, *edges, 1])[0]
    assert_allclose(counts, 64 * 64 / 8, atol=64)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("blades", 2, r"blades: expected 0 \(disc\) or 3 to 16, got 2"),
        ("blades", 17, "3 to 16, got 17"),
        ("blades", 5.5, "whole number, got 5.5"),
        ("curvature", 1.2, "curvature: expected 0 to 1, got 1.2"),
        ("rotation", math.inf, "rotation: expected a finite number"),
        ("squeeze", 0.0, "squeeze: expected 0.1 to 10, got 0"),
        ("cats_eye", -0.1, "cats_eye: expected 0 to 1.5, got -0.1"),
        ("spherical_profile", math.nan, "spherical_profile: expected -1 to 1, got nan"),
        ("onion", 1.1, "onion: expected 0 to 1, got 1.1"),
        ("onion_rings", 0.5, "onion_rings: expected 1 to 40, got 0.5"),
        ("grain", -0.1, "grain: expected 0 to 1, got -0.1"),
        ("grain_seed", -1, "grain_seed: expected a whole number from 0 up, got -1"),
        ("grain_seed", 1.5, "grain_seed: expected a whole number from 0 up, got 1.5"),
        ("obstruction", 1.0, "obstruction: expected 0 to 0.95, got 1"),
        ("picture", np.full((3, 3), -1.0), "finite values from 0 up"),
        ("picture", np.zeros((3, 3)), "expected light inside the aperture"),
    ],
)
def test_numbers_out_of_range_are_rejected(name, value, message):
    with pytest.raises(ParameterError, match=message):
        Aperture(**{name: value})


def test_picture_must_be_grey():
    with pytest.raises(ShapeError, match=r"\(H, W\)"):
        Aperture(picture=np.ones((3, 3, 3)))

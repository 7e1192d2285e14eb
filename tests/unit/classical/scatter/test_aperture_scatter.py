"""Spreading over any opening, against counted sub-pixels, moments, areas and the transposed operator."""

import math

import numba
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.scatter.aperture_scatter import scatter_backward, scatter_forward
from bokehnet.classical.scatter.aperture_table import LARGEST_TABLE, STEP, shape_table
from bokehnet.optics.aperture import Aperture, cats_eye_shift, transmission

LETTER = np.array([[1, 1, 1], [1, 0, 0], [1, 1, 0], [1, 0, 0], [1, 0, 0]])

WHOLE = {
    "disc": Aperture(),
    "blades": Aperture(blades=5, curvature=0.3, rotation=10),
    "straight": Aperture(blades=6),
    "oval ring": Aperture(squeeze=0.5, obstruction=0.4),
    "letter": Aperture(picture=LETTER),
    "rim": Aperture(spherical_profile=0.8),
}
CLIPPED = {
    "cat's-eye": Aperture(cats_eye=1.0),
    "clipped blades": Aperture(cats_eye=0.7, blades=5, spherical_profile=0.4),
}
SHAPES = WHOLE | CLIPPED


def one_point(radius: float, aperture: Aperture, dtype=np.float64) -> np.ndarray:
    """Return the blur of a point of value 1 in the middle, (N, N)."""
    size = 2 * math.ceil(abs(radius)) + 5
    values = np.zeros((size, size, 1), dtype)
    values[size // 2, size // 2] = 1
    return scatter_forward(values, np.full((size, size), radius, dtype), aperture)[..., 0]


def point_at(
    x: int, y: int, radius: float, aperture: Aperture, shape: tuple[int, int], **place
) -> np.ndarray:
    """Return the blur of a point at (x, y) of a picture."""
    values = np.zeros((*shape, 1))
    values[y, x] = 1
    return scatter_forward(values, np.full(shape, radius), aperture, **place)[..., 0]


def counted(radius: float, aperture: Aperture, size: int, oversampling: int = 40) -> np.ndarray:
    """Light on each pixel by adding up the transmission at sub-pixels, over its sum."""
    place = (np.arange(size * oversampling) + 0.5) / oversampling - size / 2
    side = 1 if radius > 0 else -1
    light = transmission(aperture, place[None, :] / radius, place[:, None] / radius, side)
    light = light.reshape(size, oversampling, size, oversampling).sum(axis=(1, 3))
    return light / light.sum()


@pytest.mark.parametrize("radius", [0.75, 2.0, -3.5, 8.25, -20.0])
@pytest.mark.parametrize("name", WHOLE)
def test_parts_are_the_light_on_each_pixel(name, radius):
    """At a step of the table. The tolerance is that of the counting and of cells 1/256 of the radius."""
    spread = one_point(radius, WHOLE[name])
    difference = np.abs(spread - counted(radius, WHOLE[name], len(spread)))
    assert difference.sum() < 0.01


@pytest.mark.parametrize("name", WHOLE)
def test_parts_between_two_steps_of_the_ladder_are_close(name):
    """Authority as above; the straight line between radii 1/4 apart blurs the rim by less than a pixel."""
    for radius in (3.0 + STEP / 2, -9.0 - STEP / 2):
        spread = one_point(radius, WHOLE[name])
        difference = np.abs(spread - counted(radius, WHOLE[name], len(spread)))
        assert difference.sum() < 0.12 / abs(radius)


@pytest.mark.parametrize("radius", [0.0, 0.6, 2.7, -7.9, 16.0, 33.3, 64.0, -64.1, 150.0])
@pytest.mark.parametrize("name", ["straight", "letter"])
def test_parts_of_one_point_sum_to_one(name, radius):
    assert one_point(radius, WHOLE[name]).sum() == pytest.approx(1, abs=1e-9)
    assert one_point(radius, WHOLE[name], np.float32).sum() == pytest.approx(1, abs=2e-5)


@pytest.mark.parametrize("radius", [0.6, 1.3, 4.1, -12.6, 40.0, 90.0])
@pytest.mark.parametrize("name", CLIPPED)
def test_parts_of_a_clipped_point_sum_to_nearly_one(name, radius):
    """The share that passes comes from a table."""
    for place in [(150, 100), (260, 30), (60, 190)]:
        x, y = (p + 100 for p in place)
        total = point_at(x, y, radius, CLIPPED[name], (400, 500)).sum()
        assert total == pytest.approx(1, abs=0.012)


def test_blur_of_half_a_pixel_is_the_identity():
    rng = np.random.default_rng(0)
    values, defocus = rng.random((20, 30, 4)), rng.uniform(-0.5, 0.5, (20, 30))
    for aperture in SHAPES.values():
        assert_array_equal(scatter_forward(values, defocus, aperture), values)
        gradients = scatter_backward(values, defocus, values, aperture)
        assert_array_equal(gradients[0], values)
        assert not gradients[1].any()


def test_letter_is_upright_behind_focus_and_turned_in_front():
    """The picture's own pixels, of 2/5 of the radius, in the order of rows and columns."""
    radius = 20
    front, behind = one_point(radius, WHOLE["letter"]), one_point(-radius, WHOLE["letter"])
    assert_allclose(behind, front[::-1, ::-1], atol=1e-12)
    middle = len(front) // 2
    for row in range(5):
        for column in range(3):
            x, y = (2 * column - 2) * radius // 5, (2 * row - 4) * radius // 5
            if math.hypot(x, y) < 0.95 * radius:
                assert (behind[middle + y, middle + x] > 5e-4) == LETTER[row, column]


@pytest.mark.parametrize("squeeze", [0.5, 1.6])
def test_squeezed_disc_has_the_moments_of_an_ellipse(squeeze):
    """A half-axis a gives the variance a^2 / 4, a pixel's own square 1/12."""
    spread = one_point(24.0, Aperture(squeeze=squeeze))
    axis = np.arange(len(spread)) - len(spread) // 2
    variance_x, variance_y = ((spread.sum(axis=a) * axis**2).sum() - 1 / 12 for a in (0, 1))
    assert variance_x == pytest.approx((24 * min(1, squeeze)) ** 2 / 4, rel=0.005)
    assert variance_y == pytest.approx((24 / max(1, squeeze)) ** 2 / 4, rel=0.005)


@pytest.mark.parametrize(("rim", "side"), [(0.8, -1), (0.8, 1), (-0.5, -1)])
def test_rim_takes_its_light_from_the_core(rim, side):
    """Of the profile 1 + p (2 rho^2 - 1), a part of 1/2 - p / 4 lies inside rho^2 = 1/2."""
    spread = one_point(side * 40.0, Aperture(spherical_profile=rim))
    y, x = np.indices(spread.shape) - len(spread) // 2
    inside = spread[x**2 + y**2 < 40**2 / 2].sum()
    assert inside == pytest.approx(0.5 + side * rim / 4, abs=0.01)


def test_obstruction_leaves_a_ring():
    """Inside 40 percent of the radius no light; its density elsewhere 1 / (pi r^2 (1 - 0.4^2))."""
    spread = one_point(30.0, Aperture(obstruction=0.4))
    y, x = np.indices(spread.shape) - len(spread) // 2
    distance = np.hypot(x, y)
    assert spread[distance < 11].max() == 0
    ring = spread[(distance > 13) & (distance < 29)]
    assert_allclose(ring, 1 / (math.pi * 900 * (1 - 0.16)), rtol=1e-4)


@pytest.mark.parametrize("radius", [12.3, -12.3, -40.0, 100.0])
@pytest.mark.parametrize("place", [(320, 240), (520, 110), (110, 120), (530, 370)])
def test_cats_eye_is_the_intersection_of_two_pupils(place, radius):
    """Discs of radius 1 at a distance s share 2 acos(s / 2) - s / 2 sqrt(4 - s^2), centred half-way."""
    x, y = place
    shape = (480, 640)
    u, v = cats_eye_shift(0.9, x, y, shape[1], shape[0])
    spread = point_at(x, y, radius, Aperture(cats_eye=0.9), shape)
    spread /= spread.sum()
    rows, columns = np.indices(shape)
    centre = (spread * columns).sum() - x, (spread * rows).sum() - y
    assert_allclose(centre, [radius * u / 2, radius * v / 2], atol=0.006 * abs(radius))
    distance = math.hypot(u, v)
    area = 2 * math.acos(distance / 2) - distance / 2 * math.sqrt(4 - distance**2)
    assert 1 / np.median(spread[spread > spread.max() / 2]) == pytest.approx(area * radius**2, rel=0.04)


def test_outer_side_of_the_cats_eye_is_lost_behind_focus():
    """At the right border: r (1 - s) to the right, with s the shift in radii, and r to the left."""
    spread = point_at(110, 50, -10.0, Aperture(cats_eye=1.0), (101, 121))
    lit = np.flatnonzero(spread.sum(axis=0) > 1e-9) - 110
    assert lit.min() == -10
    assert lit.max() == round(10 * (1 - cats_eye_shift(1.0, 110, 50, 121, 101)[0]))


def test_coarse_grids_know_their_place_in_the_picture():
    """A pixel of half the size lies between two full-size ones, and so does its cat's-eye."""
    aperture = Aperture(cats_eye=1.0)
    coarse = point_at(90, 20, -8.0, aperture, (80, 120), full_shape=(160, 240), scale=2.0)
    u, v = cats_eye_shift(1.0, 180.5, 40.5, 240, 160)
    rows, columns = np.indices(coarse.shape)
    centre = (coarse * columns).sum() / coarse.sum() - 90, (coarse * rows).sum() / coarse.sum() - 20
    assert_allclose(centre, [-8 * u / 2, -8 * v / 2], atol=0.05)


def test_cats_eye_that_blocks_everything_leaves_the_shape_whole():
    """A narrow oval and a second pupil 1.5 radii beside it have nothing in common."""
    aperture = Aperture(squeeze=0.3, cats_eye=1.5)
    blocked = point_at(300, 20, -9.0, aperture, (41, 321))
    assert_allclose(blocked, point_at(300, 20, -9.0, Aperture(squeeze=0.3), (41, 321)), atol=1e-12)


def test_a_very_large_shape_is_the_shape_a_little_softer():
    """Authority: counted sub-pixels. The lattices blur by 3/4 pixel^2: less than a pixel at the rim."""
    for name in ("straight", "letter"):
        spread = one_point(90.5, WHOLE[name])
        assert np.abs(spread - counted(90.5, WHOLE[name], len(spread), 8)).sum() < 0.03


@pytest.mark.parametrize("radius", [1e3, 1e6, 1e12])
def test_radius_far_beyond_the_picture_spreads_evenly(radius):
    values = np.random.default_rng(6).random((6, 8, 4), dtype=np.float32)
    sums = scatter_forward(values, np.full((6, 8), radius, np.float32), Aperture(blades=6))
    mean = values.mean(axis=(0, 1), keepdims=True)
    assert_allclose(sums / sums[..., 3:], np.broadcast_to(mean / mean[..., 3:], sums.shape), rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (30, 17)])
@pytest.mark.parametrize("largest", [6.0, 200.0])
@pytest.mark.parametrize("name", SHAPES)
def test_backward_is_the_transposed_forward(name, largest, shape):
    rng = np.random.default_rng(1)
    values, other, gradient = rng.random((3, *shape, 4))
    defocus = rng.uniform(-largest, largest, shape)
    gathered, _ = scatter_backward(values, defocus, gradient, SHAPES[name])
    forward = (scatter_forward(other, defocus, SHAPES[name]) * gradient).sum()
    assert (gathered * other).sum() == pytest.approx(forward, rel=1e-10)


@pytest.mark.parametrize("largest", [9.0, 150.0])
@pytest.mark.parametrize("name", SHAPES)
def test_derivative_by_the_defocus_is_that_of_the_forward(name, largest):
    """Authority: differences of the forward, away from the radius table's steps, where the slope jumps."""
    rng = np.random.default_rng(2)
    shape, step = (23, 31), 1e-5
    values, gradient = rng.random((2, *shape, 4))
    defocus = rng.uniform(-largest, largest, shape)
    place = (np.abs(defocus) - 0.5) / (STEP * np.where(np.abs(defocus) > LARGEST_TABLE, 2, 1))
    defocus = np.where(np.abs(place - np.round(place)) < 0.02, defocus + 0.013 * np.sign(defocus), defocus)
    direction = rng.choice([-1.0, 1.0], shape)
    aperture = SHAPES[name]
    ahead = scatter_forward(values, defocus + step * direction, aperture)
    behind = scatter_forward(values, defocus - step * direction, aperture)
    _, slopes = scatter_backward(values, defocus, gradient, aperture)
    expected = ((ahead - behind) * gradient).sum() / (2 * step)
    scale = np.abs(slopes).sum()
    assert (slopes * direction).sum() == pytest.approx(expected, abs=1e-5 * scale)


@pytest.mark.parametrize("channels", [1, 3, 5, 8])
def test_any_number_of_channels_gives_the_same_sums(channels):
    """Channels do not know each other: authority is the spread of each one alone."""
    rng = np.random.default_rng(3)
    values, defocus = rng.random((20, 26, channels)), rng.uniform(-6, 6, (20, 26))
    gradient = rng.random(values.shape)
    sums = scatter_forward(values, defocus, WHOLE["blades"])
    gathered, slopes = scatter_backward(values, defocus, gradient, WHOLE["blades"])
    total = np.zeros_like(slopes)
    for c in range(channels):
        one = slice(c, c + 1)
        assert_array_equal(scatter_forward(values[..., one], defocus, WHOLE["blades"]), sums[..., one])
        alone = scatter_backward(values[..., one], defocus, gradient[..., one], WHOLE["blades"])
        assert_allclose(alone[0], gathered[..., one], rtol=1e-12)
        total += alone[1]
    assert_allclose(total, slopes, atol=1e-12)


def test_any_number_of_threads_gives_the_same_bits():
    rng = np.random.default_rng(4)
    values = rng.random((150, 80, 4), dtype=np.float32)
    defocus = rng.uniform(-12, 12, (150, 80)).astype(np.float32)
    before = numba.get_num_threads()
    for aperture in (WHOLE["letter"], CLIPPED["clipped blades"]):
        results = []
        for threads in {1, before}:
            numba.set_num_threads(threads)
            sums = scatter_forward(values, defocus, aperture)
            results.append((sums, *scatter_backward(values, defocus, sums, aperture)))
        numba.set_num_threads(before)
        for result in results:
            for array, first in zip(result, results[0], strict=True):
                assert_array_equal(array, first)


def test_single_precision_is_close_to_double():
    rng = np.random.default_rng(5)
    values, defocus = rng.random((40, 50, 4)), rng.uniform(-9, 9, (40, 50))
    for aperture in SHAPES.values():
        exact = scatter_forward(values, defocus, aperture)
        single = scatter_forward(values.astype(np.float32), defocus.astype(np.float32), aperture)
        assert single.dtype == np.float32
        assert_allclose(single, exact, atol=3e-5)


def test_black_stays_black_next_to_a_strong_highlight():
    """No running sums, no streaks: a pixel that the shape does not reach gets exactly nothing."""
    spread = 1e6 * one_point(20.0, WHOLE["straight"], np.float32)
    y, x = np.indices(spread.shape) - len(spread) // 2
    assert spread[np.hypot(x, y) > 21.5].max() == 0


def test_absent_pixels_spread_nothing_and_still_have_a_gradient():
    """The transposed operator does not depend on the values."""
    rng = np.random.default_rng(7)
    values, gradient = rng.random((2, 18, 18, 4))
    defocus = rng.uniform(-5, 5, (18, 18))
    expected, _ = scatter_backward(values, defocus, gradient, WHOLE["rim"])
    none = np.zeros_like(values)
    assert not scatter_forward(none, defocus, WHOLE["rim"]).any()
    gathered, slopes = scatter_backward(none, defocus, gradient, WHOLE["rim"])
    assert_allclose(gathered, expected)
    assert not slopes.any()


def test_tables_stay_small():
    """The worst case: a picture, which is another one on each side of the focus, up to the largest radius."""
    table = shape_table(
        Aperture(picture=np.ones((4, 4)), blades=3, rotation=5, spherical_profile=0.1), 1e4, "float32"
    )
    assert sum(array.nbytes for array in table) < 32e6

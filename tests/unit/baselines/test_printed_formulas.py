"""Formulas of the theses, as printed and corrected: ``docs/method/theses_formulas.md``."""

import math

import numpy as np
import pytest

from bokehnet.baselines.rays.height_field import first_between, walk_corners
from bokehnet.baselines.spread.lommel_functions import bessel_orders, lommel_intensity


def translate(t):
    return np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, t], [0, 0, 0, 1]])


def pinhole(f):
    return np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1 / f, 0]])


def thin(f):
    return np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, -1 / f, 1]])


def on_axis(u):
    """Intensity on the axis, by the integral over the pupil: |2 int exp(i u rho^2 / 2) rho drho|^2."""
    rho = (np.arange(20000) + 0.5) / 20000
    return abs((2 * np.exp(0.5j * u * rho**2) * rho).mean()) ** 2


def test_000_3_6_has_no_sign():
    f, n, focus, depth = 50.0, 2.0, 3000.0, 1200.0
    v_p, v_d = f * focus / (focus - f), f * depth / (depth - f)
    coc = abs(v_d - v_p) * f / (n * v_d)
    cone = 0.5 * f / n * abs(depth - focus) / focus
    assert cone * v_p / depth == pytest.approx(coc / 2)
    assert coc / 2 == pytest.approx(f * f * abs(depth - focus) / (2 * n * depth * (focus - f)))


def test_000_3_14_is_of_u_and_not_of_v():
    for u in (2.0, 9.0, 31.0):
        assert lommel_intensity(u, np.array([0.0]))[0] == pytest.approx(on_axis(u), abs=1e-6)
        v = 1e-4
        bessel = bessel_orders(40, np.array([v]))[:, 0]
        wrong = [
            sum((-1) ** s * (v / u) ** (n + 2 * s) * bessel[n + 2 * s] for s in range(15)) for n in (1, 2)
        ]
        assert (2 / u) ** 2 * (wrong[0] ** 2 + wrong[1] ** 2) < 1e-12


def test_000_3_15_is_squared():
    """Field in focus: k / (2 pi) times the integral of (A / F) / F over the pupil, A the wave's amplitude."""
    k, d, focal = 2 * math.pi / 0.00055, 10.0, 50.0
    field = k / (2 * math.pi) * (math.pi * d * d / 4) / focal**2
    assert field == pytest.approx(k * d * d / (8 * focal**2))
    a, wavelength = d / 2, 0.00055
    born_wolf = (math.pi * a * a / (wavelength * focal**2)) ** 2
    assert born_wolf == pytest.approx(field**2)


def test_000_5_1_cancels_its_layers():
    rng = np.random.default_rng(0)
    light, alpha, behind = rng.random(81), rng.random(81), rng.random(81)
    v_f, v_b = (alpha * (1 - behind) * light).sum(), (alpha * behind * light).sum()
    assert (v_f + v_b) / alpha.sum() == pytest.approx((alpha * light).sum() / alpha.sum())


def test_000_5_7_is_the_range_of_a_blur():
    f, aperture, focus, c = 0.05, 0.02, 2.0, 2e-5
    for sign in (1, -1):
        depth = aperture * f * focus / (aperture * f + sign * c * (focus - f))
        assert aperture * f * abs(depth - focus) / (depth * (focus - f)) == pytest.approx(c)


def test_001_pinhole_and_thick_lens_are_in_the_other_order():
    f, t = 35.0, 4.0
    said = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0], [0, 0, -1 / f, 1]])
    assert np.allclose(translate(f) @ pinhole(-f) @ translate(-f), said)
    assert not np.allclose(translate(-f) @ pinhole(-f) @ translate(f), said)
    thick = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1 - t / f, t], [0, 0, -1 / f, 1]])
    assert np.allclose(translate(t) @ thin(f), thick)
    assert not np.allclose(thin(f) @ translate(t), thick)
    inverse = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -t], [0, 0, 1 / f, 1 - t / f]])
    assert np.allclose(inverse @ thick, np.eye(4))
    assert not np.allclose(np.linalg.inv(translate(t)) @ np.linalg.inv(thin(f)), inverse)


def test_002_4_5_keeps_the_sensor_where_it_is():
    reference, focus, other = 0.05, 2.0, 0.0508
    depth = reference * focus * other / (reference * focus - other * focus + other * reference)
    assert other * depth / (depth - other) == pytest.approx(reference * focus / (focus - reference))


def test_004_2_1_does_not_depend_on_the_depth():
    aperture, focal, focus = 0.025, 0.05, 2.0
    printed = [abs(aperture * d * focus / (d * (focus - focal))) for d in (0.5, 2.0, 9.0)]
    assert max(printed) == pytest.approx(min(printed))
    right = [abs(aperture * focal * (focus - d) / (d * (focus - focal))) for d in (0.5, 2.0, 9.0)]
    assert right[1] == 0
    for d, coc in zip((0.5, 9.0), (right[0], right[2]), strict=True):
        image, sensor = focal * d / (d - focal), focal * focus / (focus - focal)
        assert coc == pytest.approx(aperture * abs(sensor - image) / image)


def test_004_2_2_and_its_listing_are_turned_by_half_an_edge():
    for blades in (3, 5, 8):
        edge = math.pi / blades

        def printed(angle, edge=edge):
            return math.cos(edge) / math.cos(angle % (2 * edge) - edge)

        def listing(angle, edge=edge, blades=blades):
            turns = math.floor((blades * angle + math.pi) / 2 / math.pi)
            return math.cos(edge) / math.cos(angle - 2 * edge * turns)

        assert printed(0.0) == pytest.approx(1)
        assert listing(0.0) == pytest.approx(math.cos(edge))
        for angle in np.linspace(0.01, 6, 50):
            assert listing(angle) == pytest.approx(printed(angle + edge))


def test_004_the_grey_of_its_vignette_is_too_bright():
    grey = np.full(3, 0.4)
    assert np.linalg.norm(grey) == pytest.approx(math.sqrt(3) * 0.4)


def test_001_4_2_1_leaves_a_pixel_on_the_other_side():
    """A way from (0, 0) that reaches the upper edge of its pixel before the right one goes upwards."""
    end, corner, sign = np.array([1.0, 2.0]), np.array([1.0, 1.0]), np.array([1.0, 1.0])
    normal = np.array([-sign[1], sign[0]])
    x, y = -corner, end - corner
    side = x[0] * y[1] - x[1] * y[0]
    printed = (sign + normal) / 2 if side > 0 else (sign - normal) / 2
    assert end[0] / end[1] < 1  # at y = 1 the way is still left of x = 1
    assert printed.tolist() == [1, 0]
    z = np.full((2, 1, 1), 0.5)
    z[0] = 2.0
    result = walk_corners(z, np.ones((2, 1), np.int64), (0.0, 0.0, 0.0), (1.0, 2.0, 0.9), 0.0)
    assert result == (1, 0, 0)


def test_001_algorithm_2_leaves_out_every_second_layer():
    depths, near, far = [0.1, 0.5, 0.9], 0.4, 0.6

    def printed(step):
        i = 0
        while i < len(depths) and depths[i] <= far:
            if near < depths[i] <= far:
                return i
            i += step
        return -1

    z = np.array(depths).reshape(1, 1, 3)
    right = first_between(z, np.array([[3]]), 0, 0, near, far)
    assert (printed(2), printed(1), right) == (-1, 1, 1)

import numpy as np
import pytest

from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.depth_discontinuities import discontinuity_sides
from bokehnet.classical.layered.unmixing import (
    _LEAST,
    _MIXED,
    _PIXEL_FILTER,
    _RELATIVE,
    _SHARE_SPREAD,
    _SQUARE,
    _WINDOW,
    unmix,
)

NOTHING_SPARED = np.zeros((20, 24), bool)


def scene(seed=0, least=0.0):
    """A slanted edge between two textured surfaces, seen through the pixel filter; 20x24 pixels."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:20, :24]
    front = columns + 0.3 * rows < 14
    near = np.array([0.7, 0.2, 0.1]) + 0.1 * rng.random((20, 24, 3)) + least
    far = np.array([0.1, 0.3, 0.9]) + 0.1 * rng.random((20, 24, 3)) + least
    label = np.pad(front.astype(float), 1, "edge")
    share = sum(
        _PIXEL_FILTER[i] * _PIXEL_FILTER[j] * label[i : i + 20, j : j + 24]
        for i in range(3)
        for j in range(3)
    )
    image = share[..., None] * near + (1 - share[..., None]) * far
    return image.astype(np.float32), np.where(front, 6.0, -9.0).astype(np.float32), share, near, far


def literal(image, defocus, sides, y, x):
    """The docstring's problem for one pixel, by dense linear algebra; light may be negative."""
    depths = {True: defocus.max(), False: defocus.min()}

    def mean(depth):
        total, colors, squares = 0.0, np.zeros(3), 0.0
        for v in range(max(0, y - _WINDOW), min(20, y + _WINDOW + 1)):
            for u in range(max(0, x - _WINDOW), min(24, x + _WINDOW + 1)):
                if defocus[v, u] == depth:
                    weight = np.exp(-((v - y) ** 2 + (u - x) ** 2) / _SQUARE) * (_MIXED if sides[v, u] else 1)
                    color = image[v, u].astype(float)
                    total, colors = total + weight, colors + weight * color
                    squares += weight * (color @ color)
        colors /= total
        return colors, (squares / total - colors @ colors) / 3

    (front, front_variance), (back, back_variance) = mean(depths[True]), mean(depths[False])
    least = _LEAST**2 + _RELATIVE**2 * (front @ front + back @ back) / 3
    around = np.pad(defocus, 1, "edge")[y : y + 3, x : x + 3] == depths[True]
    share = float((np.outer(_PIXEL_FILTER, _PIXEL_FILTER) * around).sum())
    prior = np.diag([_SHARE_SPREAD**2] + 3 * [front_variance + least] + 3 * [back_variance + least])
    row = np.hstack([(front - back)[:, None], share * np.eye(3), (1 - share) * np.eye(3)])
    error = image[y, x] - share * front - (1 - share) * back
    moved = prior @ row.T @ np.linalg.solve(row @ prior @ row.T, error)
    share, front, back = min(max(share + moved[0], 0.0), 1.0), front + moved[1:4], back + moved[4:]
    error = image[y, x] - share * front - (1 - share) * back  # of second order
    weights = np.array([share * prior[1, 1], (1 - share) * prior[4, 4]])
    weights /= share * weights[0] + (1 - share) * weights[1]
    return share, front + weights[0] * error, back + weights[1] * error


def test_pixels_are_parted_as_the_least_squares_say():
    """Oracle: the same problem with dense matrices."""
    image, defocus, *_ = scene(least=0.2)
    sides = discontinuity_sides(defocus)
    found = unmix(image, defocus, sides, NOTHING_SPARED)
    assert len(found.rows) == np.count_nonzero(sides) > 30
    for i, (y, x) in enumerate(zip(found.rows, found.columns, strict=True)):
        share, front, back = literal(image, defocus, sides, y, x)
        assert found.coverage[i] == pytest.approx(share, abs=1e-5)
        np.testing.assert_allclose(found.front[i], front, atol=1e-5)
        np.testing.assert_allclose(found.back[i], back, atol=1e-5)


@pytest.mark.parametrize("lowest", [0.0, -0.2])
def test_both_surfaces_add_up_to_the_picture(lowest):
    image = np.random.default_rng(1).uniform(lowest, 1, (20, 24, 3)).astype(np.float32)
    defocus = scene()[1]
    found = unmix(image, defocus, discontinuity_sides(defocus), NOTHING_SPARED)
    share = found.coverage[:, None]
    added = share * found.front + (1 - share) * found.back
    np.testing.assert_allclose(added, image[found.rows, found.columns], atol=1e-5)
    if lowest == 0.0:
        assert min(found.front.min(), found.back.min()) >= 0


def test_colours_are_purer_than_the_picture():
    """Truth: the surfaces that the picture was mixed of."""
    image, defocus, share, near, far = scene()
    found = unmix(image, defocus, discontinuity_sides(defocus), NOTHING_SPARED)
    own = np.where(found.is_front[:, None], found.front, found.back)
    y, x = found.rows, found.columns
    truth = np.where(found.is_front[:, None], near[y, x], far[y, x])
    assert np.abs(own - truth).mean() < 0.5 * np.abs(image[y, x] - truth).mean()
    assert np.abs(found.coverage - share[y, x]).mean() < 0.03


def test_a_light_is_spared_and_colours_nothing():
    image, defocus, *_ = scene()
    plain = unmix(image, defocus, discontinuity_sides(defocus), NOTHING_SPARED)
    lit, spared = image.copy(), NOTHING_SPARED.copy()
    lit[10, 10], spared[10, 10] = 100.0, True
    found = unmix(lit, defocus, discontinuity_sides(defocus), spared)
    assert not ((found.rows == 10) & (found.columns == 10)).any()
    assert found.front.max() < plain.front.max() + 0.1


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1)])
def test_small_pictures(shape):
    rng = np.random.default_rng(2)
    image = rng.random((*shape, 3), dtype=np.float32)
    defocus = rng.uniform(-9, 9, shape).astype(np.float32)
    found = unmix(image, defocus, discontinuity_sides(defocus), np.zeros(shape, bool))
    for array in (found.front, found.back, found.coverage):
        assert np.isfinite(array).all()
    assert (found.near >= found.far).all()


def test_a_held_coverage_stays_and_both_surfaces_add_up():
    image, defocus, share, near, far = scene()
    y, x = np.nonzero((share > 0) & (share < 1))
    held = KnownSurfaces(
        rows=y,
        columns=x,
        near=np.full(len(y), 6.0),
        far=np.full(len(y), -9.0),
        coverage=share[y, x],
    )
    found = unmix(image, defocus, np.zeros((20, 24), np.int8), NOTHING_SPARED, held)
    np.testing.assert_array_equal(np.stack([found.rows, found.columns]), np.stack([y, x]))
    np.testing.assert_allclose(found.coverage, share[y, x], atol=1e-6)
    assert (found.near == 6).all()
    weight = found.coverage[:, None]
    np.testing.assert_allclose(weight * found.front + (1 - weight) * found.back, image[y, x], atol=1e-5)
    estimated = unmix(image, defocus, discontinuity_sides(defocus), NOTHING_SPARED)

    def error(result):
        own = np.where(result.is_front[:, None], result.front, result.back)
        truth = np.where(
            result.is_front[:, None], near[result.rows, result.columns], far[result.rows, result.columns]
        )
        return np.abs(own - truth).mean()

    assert error(found) < 1.1 * error(estimated)


def test_a_light_is_spared_though_its_coverage_is_held():
    image, defocus, *_ = scene()
    spared = NOTHING_SPARED.copy()
    spared[10, 10] = True
    held = KnownSurfaces(
        rows=np.array([10, 10]),
        columns=np.array([10, 11]),
        near=np.full(2, 6.0),
        far=np.full(2, -9.0),
        coverage=np.array([0.3, 0.4]),
    )
    found = unmix(image, defocus, np.zeros((20, 24), np.int8), spared, held)
    assert found.columns.tolist() == [11]
    assert found.coverage[0] == np.float32(0.4)

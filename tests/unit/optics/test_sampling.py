import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.optics.sampling import disc_from_square, halton, rotate_points, sobol


def test_halton_in_base_two_reverses_the_bits():
    assert_allclose(halton(7, 2), [1 / 2, 1 / 4, 3 / 4, 1 / 8, 5 / 8, 3 / 8, 7 / 8])
    assert_allclose(halton(4, 3), [1 / 3, 2 / 3, 1 / 9, 4 / 9])


@pytest.mark.parametrize("first", [0, 64, 512])
def test_every_box_of_its_share_holds_one_point_of_a_sobol_block(first):
    """Sobol's first two dimensions are a (0, 2)-sequence in base 2; Owen's scrambling keeps that."""
    points = sobol(first + 64, np.random.default_rng(3))[first:]
    assert points.min() >= 0
    assert points.max() < 1
    for wide in range(7):
        boxes = np.floor(points * [2**wide, 2 ** (6 - wide)]).astype(int)
        assert len(np.unique(boxes, axis=0)) == 64


@pytest.mark.parametrize("first", [0, 8, 1024])
def test_every_axis_of_a_sobol_block_is_evenly_filled(first):
    """Each axis by itself is a (0, 1)-sequence in base 2."""
    points = sobol(first + 8, np.random.default_rng(4), 5)[first:]
    assert points.shape == (8, 5)
    for axis in range(5):
        assert sorted(np.floor(8 * points[:, axis])) == list(range(8))


def test_no_two_axes_of_sobol_points_go_together():
    """Authority: SciPy, whose pairs of axes average products as well."""
    qmc = pytest.importorskip("scipy.stats").qmc
    places = [sobol(1024, np.random.default_rng(seed), 5) for seed in range(8)]
    others = [qmc.Sobol(5, scramble=True, seed=seed).random(1024) for seed in range(8)]
    errors = [
        np.sqrt(np.mean([(np.cov(p.T) - np.eye(5) / 12) ** 2 for p in cubes], axis=0)).max()
        for cubes in (places, others)
    ]
    assert errors[0] < 1.5 * errors[1] < 0.001


def test_sobol_averages_are_as_good_as_those_of_scipy():
    """Averages of smooth functions over 1024 points agree far below what independent points would give."""
    qmc = pytest.importorskip("scipy.stats").qmc
    for values in (lambda p: p[:, 0] * p[:, 1], lambda p: np.exp(p[:, 0]) * np.cos(p[:, 1])):
        truth = values(qmc.Sobol(2, scramble=True, seed=1).random(65536)).mean()
        results = [values(sobol(1024, np.random.default_rng(seed))).mean() for seed in range(8)]
        assert_allclose(results, truth, atol=1e-4)


def test_scrambled_points_are_uniform_and_differ_by_seed():
    one = np.array([sobol(5, np.random.default_rng(seed))[4] for seed in range(2000)])
    assert_allclose(one.mean(0), 0.5, atol=0.03)
    assert_allclose(one.var(0), 1 / 12, atol=0.01)
    assert abs(np.corrcoef(one.T)[0, 1]) < 0.08


def test_disc_points_are_uniform_by_area():
    """For a uniform unit disc <x> = <y> = 0, <r^2> = 1/2 and r^2 is uniform in [0, 1]."""
    points = disc_from_square(np.stack([halton(4096, 2), halton(4096, 3)], -1))
    radius2 = (points**2).sum(-1)
    assert radius2.max() <= 1 + 1e-12
    assert_allclose(points.mean(0), 0, atol=2e-3)
    assert_allclose(np.quantile(radius2, [0.1, 0.25, 0.5, 0.75, 0.9]), [0.1, 0.25, 0.5, 0.75, 0.9], atol=5e-3)


def test_the_centre_and_the_corners_map_where_they_should():
    corners = np.array([[0.5, 0.5], [1.0, 0.5], [0.5, 1.0], [1.0, 1.0]])
    expected = [[0, 0], [1, 0], [0, 1], [np.sqrt(0.5), np.sqrt(0.5)]]
    assert_allclose(disc_from_square(corners), expected, atol=1e-12)
    assert_allclose(disc_from_square(torch.from_numpy(corners)).numpy(), expected, atol=1e-12)


def test_rotation_wraps_round():
    assert_allclose(rotate_points(np.array([[0.9, 0.2]]), np.array([0.3, 0.5])), [[0.2, 0.7]])

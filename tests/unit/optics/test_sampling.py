import numpy as np
import torch
from numpy.testing import assert_allclose

from bokehnet.optics.sampling import disc_from_square, halton, rotate_points


def test_halton_in_base_two_reverses_the_bits():
    assert_allclose(halton(7, 2), [1 / 2, 1 / 4, 3 / 4, 1 / 8, 5 / 8, 3 / 8, 7 / 8])
    assert_allclose(halton(4, 3), [1 / 3, 2 / 3, 1 / 9, 4 / 9])


def test_disc_points_are_uniform_by_area():
    """For a uniform unit disc <x> = <y> = 0, <r^2> = 1/2 and r^2 is uniform in [0, 1]."""
    points = disc_from_square(np.stack([halton(4096, 2), halton(4096, 3)], -1))
    radius2 = (points**2).sum(-1)
    assert radius2.max() <= 1 + 1e-12
    assert_allclose(points.mean(0), 0, atol=2e-3)
    assert_allclose(np.quantile(radius2, [0.1, 0.25, 0.5, 0.75, 0.9]), [0.1, 0.25, 0.5, 0.75, 0.9], atol=5e-3)


def test_the_centre_and_the_corners_map_where_they_should():
    corners = np.array([[0.5, 0.5], [1.0, 0.5], [0.5, 1.0], [1.0, 1.0]])
    wanted = [[0, 0], [1, 0], [0, 1], [np.sqrt(0.5), np.sqrt(0.5)]]
    assert_allclose(disc_from_square(corners), wanted, atol=1e-12)
    assert_allclose(disc_from_square(torch.from_numpy(corners)).numpy(), wanted, atol=1e-12)


def test_rotation_wraps_round():
    assert_allclose(rotate_points(np.array([[0.9, 0.2]]), np.array([0.3, 0.5])), [[0.2, 0.7]])

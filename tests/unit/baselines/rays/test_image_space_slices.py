"""Slices of the space behind a lens against discs in closed form."""

import numpy as np
import pytest

from bokehnet.baselines.rays.image_space_slices import image_space
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.optics.focus_plane import FocusPlane

HEIGHT, WIDTH, BLUR = 60, 100, 40.0
PLANE = FocusPlane(level=0.1, slope=(0.006, 0.0))


def test_a_point_is_an_ellipse_off_its_middle():
    """Authority: a point at q of defocus d lights q + d a / (1 + t a_x), t = blur times the focus's slope."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    image[30, 50] = 1
    disparity = np.full((HEIGHT, WIDTH), 0.7)
    space = image_space(image, disparity, BLUR, (0.0, 0.8), count=65)
    lit = space.view(PLANE)[..., 0]
    defocus, lean = BLUR * (0.7 - (0.1 + 0.006 * 50)), BLUR * 0.006
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    right, down = x - 50.0, y - 30.0
    inside = np.hypot(right, down) <= defocus - lean * right  # |p - q| <= the defocus at p
    edge = np.abs(np.hypot(right, down) - (defocus - lean * right)) < 1.5
    assert np.array_equal((lit > 1e-5)[~edge], inside[~edge])
    assert right[inside].min() == pytest.approx(-defocus / (1 - lean), abs=1)
    assert right[inside].max() == pytest.approx(defocus / (1 + lean), abs=1)


def test_upright_planes_are_the_slices_and_what_is_between_is_a_mixture():
    rng = np.random.default_rng(0)
    image, disparity = rng.random((20, 24, 3)).astype(np.float32), rng.random((20, 24))
    space = image_space(image, disparity, 6.0, (0.0, 1.0), count=5)
    assert np.array_equal(space.view(FocusPlane(level=0.5)), space.slices[2])
    assert np.allclose(space.view(FocusPlane(level=1.0)), space.slices[4], atol=1e-6)
    mean = (space.slices[0] + 3 * space.slices[1]) / 4
    assert np.allclose(space.view(FocusPlane(level=0.1875)), mean, atol=1e-6)


def test_bad_input_is_reported():
    image, disparity = np.zeros((8, 9, 3), np.float32), np.zeros((8, 9))
    with pytest.raises(ShapeError, match="disparity"):
        image_space(image, disparity[1:], 5.0, (0, 1))
    with pytest.raises(ParameterError, match="foci"):
        image_space(image, disparity, 5.0, (1, 1))
    with pytest.raises(ParameterError, match="count"):
        image_space(image, disparity, 5.0, (0, 1), count=1)
    with pytest.raises(ParameterError, match=r"plane: expected a focus within .* 0 to 1, got"):
        image_space(image, disparity, 5.0, (0, 1)).view(FocusPlane(level=0.5, slope=(0.2, 0)))

"""Resolution multiplier of the gathers of thesis 004."""

import numpy as np
import pytest

from bokehnet.baselines import gather_basic, gather_bokeh, gather_spiral
from bokehnet.baselines.gather.resolution import resized
from bokehnet.errors import ParameterError

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("method", [gather_basic, gather_spiral, gather_bokeh])
def test_half_the_resolution_is_the_method_on_means_of_four_pixels(method):
    """Oracle: block means, every other defocus halved, the method, and linear interpolation written out."""
    image = RNG.random((16, 24, 3)).astype(np.float32)
    defocus = np.full((16, 24), 4.0, np.float32)
    small = method(image.reshape(8, 2, 12, 2, 3).mean((1, 3)), np.full((8, 12), 2.0, np.float32))
    result = method(image, defocus, resolution=0.5)
    for y, x in ((0, 0), (5, 7), (15, 23), (8, 12)):
        v, u = min(max((y + 0.5) / 2 - 0.5, 0), 7), min(max((x + 0.5) / 2 - 0.5, 0), 11)
        j, i = min(int(v), 6), min(int(u), 10)
        b, a = v - j, u - i
        expected = (1 - b) * ((1 - a) * small[j, i] + a * small[j, i + 1])
        expected = expected + b * ((1 - a) * small[j + 1, i] + a * small[j + 1, i + 1])
        assert result[y, x] == pytest.approx(expected, abs=1e-5)


def test_one_is_the_method_itself_and_light_stays():
    image = RNG.random((20, 30, 3)).astype(np.float32)
    defocus = np.full((20, 30), 3.0, np.float32)
    assert (gather_spiral(image, defocus, resolution=1.0) == gather_spiral(image, defocus)).all()
    flat = np.full_like(image, 0.3)
    for resolution in (0.4, 0.75, 2.0):
        assert gather_spiral(flat, defocus, resolution=resolution) == pytest.approx(0.3, abs=1e-4)
    with pytest.raises(ParameterError, match="resolution"):
        gather_spiral(image, defocus, resolution=0.01)


def test_reducing_keeps_the_mean():
    image = RNG.random((17, 23, 3)).astype(np.float32)
    assert resized(image, (5, 9)).mean((0, 1)) == pytest.approx(image.mean((0, 1)), abs=1e-6)

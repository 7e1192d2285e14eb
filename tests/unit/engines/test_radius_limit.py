"""The bound of the blur radius. Authority: the picture at the bound, four times the longer side."""

import numpy as np
import pytest

from bokehnet.classical.base import MAX_RADIUS_IN_SIDES
from bokehnet.engine_registry import ENGINES
from bokehnet.engines.engine import Engine


@pytest.mark.parametrize("name", list(ENGINES))
@pytest.mark.parametrize("radius", [1e6, 1e30])
def test_larger_radii_render_as_the_bound(name, radius):
    rng = np.random.default_rng(0)
    image = rng.random((12, 16, 3), dtype=np.float32)
    shape = np.sign(rng.random((12, 16), dtype=np.float32) - 0.5)
    engine, limit = Engine(name), MAX_RADIUS_IN_SIDES * 16
    result = engine.render(image, shape * np.float32(radius))
    assert result.largest_blur == limit
    np.testing.assert_array_equal(result.bokeh, engine.render(image, shape * np.float32(limit)).bokeh)

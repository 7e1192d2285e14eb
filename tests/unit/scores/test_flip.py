"""FLIP against its authors' own program."""

import numpy as np
import pytest

from bokehnet.errors import ParameterError, ShapeError
from bokehnet.scores.flip import flip_map


def pair(height=60, width=80):
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:height, :width]
    base = 0.5 + 0.4 * np.sin(x / 7)[..., None] * np.cos(y[..., None] / np.array([5, 9, 13]))
    test = np.clip(base + 0.1 * rng.normal(size=base.shape), 0, 1)
    test[20:30, 30:50] = (1, 0.2, 0)
    return base.astype(np.float32), test.astype(np.float32)


@pytest.mark.parametrize("pixels_per_degree", [67.0, 40.0])
def test_it_equals_the_output_of_the_authors_program(pixels_per_degree):
    evaluator = pytest.importorskip("flip_evaluator")
    reference, test = pair()
    reports = {"ppd": pixels_per_degree}
    expected = evaluator.evaluate(reference, test, "LDR", applyMagma=False, parameters=reports)[0][..., 0]
    assert np.abs(flip_map(reference, test, pixels_per_degree) - expected).max() < 2e-3


def test_it_is_symmetric_and_zero_for_the_same():
    reference, test = pair()
    assert np.allclose(flip_map(reference, test), flip_map(test, reference), atol=1e-6)
    assert not flip_map(test, test).any()


def test_the_whole_range_is_between_black_and_white():
    black, white = np.zeros((30, 30, 3)), np.ones((30, 30, 3))
    assert flip_map(black, white).mean() == pytest.approx(0.969, abs=0.01)


def test_bad_pictures_are_refused():
    reference, test = pair()
    with pytest.raises(ShapeError):
        flip_map(reference, test[1:])
    with pytest.raises(ParameterError, match="pixels_per_degree"):
        flip_map(reference, test, 0)

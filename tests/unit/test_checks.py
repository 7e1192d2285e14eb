import numpy as np
import pytest

from bokehnet import checks
from bokehnet.errors import ParameterError, ShapeError


def test_array_namespace_of_arrays_and_floats_is_numpy():
    assert checks.array_namespace(np.zeros(2)) is np
    assert checks.array_namespace(0.5) is np


def test_array_namespace_of_tensors_is_torch():
    torch = pytest.importorskip("torch")
    assert checks.array_namespace(torch.zeros(2)) is torch


def test_array_namespace_does_not_import_torch(python_process):
    source = (
        "import sys, numpy; from bokehnet.checks import array_namespace\n"
        "array_namespace(numpy.ones(1)); sys.exit('torch' in sys.modules)"
    )
    assert python_process(source).code == 0


@pytest.mark.parametrize("shape", [(4, 5), (4, 5, 4), (4, 5, 1), (0, 5, 3), (2, 4, 5, 3)])
def test_check_image_refuses_other_shapes(shape):
    with pytest.raises(ShapeError, match="photo"):
        checks.check_image("photo", np.zeros(shape))


def test_check_image_accepts_rgb_and_values_above_one():
    checks.check_image("photo", np.full((2, 3, 3), 1e6, np.float32))


@pytest.mark.parametrize("shape", [(4,), (4, 5, 1), (4, 0)])
def test_check_map_refuses_other_shapes(shape):
    with pytest.raises(ShapeError, match=r"disparity.*\(H, W\)"):
        checks.check_map("disparity", np.zeros(shape))


def test_check_finite_counts_nan_and_infinity():
    values = np.array([0.0, np.nan, np.inf, -np.inf])
    with pytest.raises(ParameterError, match=r"depth.* 3 "):
        checks.check_finite("depth", values)


def test_check_finite_takes_tensors():
    torch = pytest.importorskip("torch")
    checks.check_finite("depth", torch.ones(3))
    with pytest.raises(ParameterError, match=" 1 "):
        checks.check_finite("depth", torch.tensor([1.0, float("nan")]))


def test_check_same_size_tells_both_sizes_as_width_by_height_and_the_way_out():
    with pytest.raises(ShapeError, match=r"a is 6x4 .* b is 3x2; .*; pass --resize"):
        checks.check_same_size("a", np.zeros((4, 6, 3)), "b", np.zeros((2, 3)), hint="pass --resize")
    checks.check_same_size("a", np.zeros((4, 6, 3)), "b", np.zeros((4, 6)))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_check_number_refuses_what_is_not_finite(value):
    with pytest.raises(ParameterError, match="blur"):
        checks.check_number("blur", value)


def test_check_at_least_includes_its_bound():
    checks.check_at_least("blur", 0.0, 0.0)
    with pytest.raises(ParameterError, match=r"blur: expected at least 0, got -0\.5"):
        checks.check_at_least("blur", -0.5, 0.0)
    with pytest.raises(ParameterError, match="finite"):
        checks.check_at_least("blur", float("nan"), 0.0)


def test_check_choice_lists_the_choices_in_order():
    checks.check_choice("engine", "a", ["b", "a"])
    with pytest.raises(ParameterError, match="engine: expected one of a, b, got 'c'"):
        checks.check_choice("engine", "c", ["b", "a"])

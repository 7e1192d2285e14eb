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


def test_check_same_size_reports_both_sizes_as_width_by_height_and_the_way_out():
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


NO_NUMBERS = ["3", None, True, np.True_, 1j, [1.0], np.zeros(2), b"1", object()]


@pytest.mark.parametrize("value", NO_NUMBERS)
@pytest.mark.parametrize(
    "check",
    [
        checks.check_number,
        lambda name, value: checks.check_at_least(name, value, -1),
        lambda name, value: checks.check_above(name, value, -1),
        lambda name, value: checks.check_range(name, value, -1, 9),
        checks.check_whole,
        lambda name, value: checks.check_numbers(name, (0.5, value), 2),
        lambda name, value: checks.check_numbers(name, value, 2),
    ],
    ids=range(7),
)
def test_what_is_no_number_is_refused(check, value):
    with pytest.raises(ParameterError, match=r"^blur: expected .* got ") as caught:
        check("blur", value)
    assert caught.value.parameter == "blur"


def test_number_of_accepts_only_numbers_of_all_kinds():
    for number in (2, 2.0, np.float32(2), np.int8(2), np.array(2)):
        assert checks.number_of(number) == 2.0
    assert np.isnan([checks.number_of(value) for value in NO_NUMBERS]).all()
    assert checks.number_of(10**400) == np.inf
    assert checks.number_of(-(10**400)) == -np.inf


def test_number_of_takes_tensors_that_learn():
    torch = pytest.importorskip("torch")
    assert checks.number_of(torch.tensor(0.5, requires_grad=True)) == 0.5


def test_check_range_includes_both_ends():
    checks.check_range("size", 0, 0, 50)
    checks.check_range("size", 50, 0, 50)
    for value, text in ((50.5, r"50\.5"), (-1, "-1"), (np.nan, "nan"), (np.inf, "inf"), ("x", "'x'")):
        with pytest.raises(ParameterError, match=f"^size: expected 0 to 50 pixels, got {text}$"):
            checks.check_range("size", value, 0, 50, "pixels")


def test_check_above_excludes_its_bound_and_infinity():
    checks.check_above("pitch", 1e-9, 0, "mm")
    with pytest.raises(ParameterError, match=r"^pitch: expected more than 0 mm, got 0$"):
        checks.check_above("pitch", 0, 0, "mm")
    with pytest.raises(ParameterError, match=r"^pitch: expected more than 0 mm and finite, got inf$"):
        checks.check_above("pitch", np.inf, 0, "mm")


def test_check_whole_goes_by_the_value():
    checks.check_whole("seed", 3.0, 0)
    checks.check_whole("left", -3)
    with pytest.raises(ParameterError, match=r"^seed: expected a whole number from 0 up, got -1$"):
        checks.check_whole("seed", -1, 0)
    with pytest.raises(ParameterError, match=r"^seed: expected a whole number, got 0\.5$"):
        checks.check_whole("seed", 0.5)


def test_check_flag_takes_no_numbers():
    checks.check_flag("mono", np.True_)
    with pytest.raises(ParameterError, match=r"^mono: expected True or False, got 1$"):
        checks.check_flag("mono", 1)


def test_check_kind_reports_the_classes():
    checks.check_kind("name", None, str, optional=True)
    with pytest.raises(ParameterError, match=r"^name: expected str or bytes or None, got 3$"):
        checks.check_kind("name", 3, str, bytes, optional=True)


@pytest.mark.parametrize("values", ["x", None, [[1.0], [1.0, 2.0]], 10**400, [object()], 1j, True])
def test_array_of_numbers_refuses_other_objects(values):
    with pytest.raises(ParameterError, match=r"^picture: expected an array of numbers, got "):
        checks.array_of_numbers("picture", values, np.float32)


def test_array_of_numbers_is_a_copy():
    mask = np.ones((2, 3), bool)
    array = checks.array_of_numbers("picture", mask, np.float32)
    assert array.dtype == np.float32
    assert array.shape == (2, 3)


@pytest.mark.parametrize("value", [None, "x", [[0.5]]])
def test_non_arrays_are_reported(value):
    with pytest.raises(ParameterError, match=r"^depth: expected an array of shape \(H, W\), got "):
        checks.check_map("depth", value)
    with pytest.raises(ParameterError, match=r"^depth: expected an array of numbers, got an array of shape"):
        checks.check_map("depth", np.array([["x"]]))


def test_check_choice_refuses_what_is_no_text():
    for value in (None, ["a"], 3):
        with pytest.raises(ParameterError, match=r"^engine: expected one of a, b, got "):
            checks.check_choice("engine", value, {"a": 1, "b": 2})


@pytest.mark.parametrize("light", [1e16, -1e16])
def test_light_beyond_all_measure_is_refused_and_the_brightest_is_not(light):
    """Its square, summed over a picture, is no float32 any more."""
    image = np.zeros((2, 3, 3), np.float32)
    image[1, 2, 0] = checks.MAX_LIGHT
    checks.check_light("photo", image)
    image[0, 0, 1] = light
    with pytest.raises(ParameterError, match=r"photo: expected light of at most 1e\+15.*got -?1e\+16"):
        checks.check_light("photo", image)

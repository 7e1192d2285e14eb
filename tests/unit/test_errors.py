"""ParameterError: its message, its parts, and its way through processes."""

import copy
import math
import pickle
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

from bokehnet.errors import BokehnetError, ImageFileError, LensError, ParameterError


def parts(error):
    return str(error), error.parameter, error.expected, error.got, error.has_got, error.remedy


def test_the_message_has_all_four_parts():
    error = ParameterError("curvature", "0 to 1", 1.2, "take less")
    assert str(error) == "curvature: expected 0 to 1, got 1.2; take less"
    assert (error.parameter, error.expected, error.got, error.remedy) == (
        "curvature",
        "0 to 1",
        1.2,
        "take less",
    )
    assert isinstance(error, BokehnetError)
    assert isinstance(error, ValueError)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"expected": "0 to 1"}, "blur: expected 0 to 1"),
        ({"got": 3}, "blur: got 3"),
        ({"remedy": "leave it out"}, "blur: leave it out"),
        ({"expected": "0 to 1", "remedy": "take less"}, "blur: expected 0 to 1; take less"),
        ({"got": 3, "remedy": "take less"}, "blur: got 3; take less"),
        ({"expected": "a number", "got": None}, "blur: expected a number, got None"),
        (
            {"expected": "at most 9 MB", "got": 10**7, "shown": "10 MB"},
            "blur: expected at most 9 MB, got 10 MB",
        ),
        ({"expected": "finite values", "shown": "3 NaN"}, "blur: expected finite values, got 3 NaN"),
    ],
)
def test_empty_parts_are_left_out(arguments, message):
    assert str(ParameterError("blur", **arguments)) == message


@pytest.mark.parametrize(
    ("result", "text"),
    [
        (None, "None"),
        (True, "True"),
        (3, "3"),
        (123456789, "123456789"),
        (0.1 + 0.2, "0.3"),
        (math.nan, "nan"),
        (np.float32(0.1), "0.1"),
        (np.int64(7), "7"),
        (np.array(0.5), "0.5"),
        ("rays2", "'rays2'"),
        ("", "''"),
        ((0.1 + 0.2, np.float64(1), "x"), "(0.3, 1, 'x')"),
        ((2.0,), "(2,)"),
        ([1, [2.5]], "[1, [2.5]]"),
        (np.zeros((2, 3)), "an array of shape (2, 3)"),
        ({"a": 1}, "{'a': 1}"),
        ("a\nb", r"'a\nb'"),
        (..., "Ellipsis"),
    ],
)
def test_values_are_abbreviated(result, text):
    error = ParameterError("blur", "something else", result)
    assert str(error) == f"blur: expected something else, got {text}"
    assert error.got is result


def test_long_values_are_cut():
    assert str(ParameterError("blur", "less", 10**5000)) == "blur: expected less, got a value of type int"
    assert len(str(ParameterError("blur", "a number", "x" * 10_000))) < 200
    assert len(str(ParameterError("blur", "a number", list(range(10_000))))) < 200


def test_an_omitted_value_differs_from_none():
    assert ParameterError("blur", "a number", None).has_got
    assert ParameterError("blur", "a number", None).got is None
    assert not ParameterError("blur", "a number").has_got
    counted = ParameterError("blur", "finite values", shown="3 that are NaN")
    assert counted.has_got
    assert counted.got == "3 that are NaN"


@pytest.mark.parametrize(
    ("message", "parameter"),
    [
        ("curvature: expected 0 to 1, got 2", "curvature"),
        ("--blade-curvature: expected 0 to 1: or none", "--blade-curvature"),
        ("lens.focus_distance: expected more", "lens.focus_distance"),
        ("quads[0].radius: expected more", "quads[0].radius"),
        ("--a, --b: expected --engine rays", ""),
        ("a pull: expected distances above 0", ""),
        ("expected one of --a and --b, found both", ""),
        ("--a needs --b", ""),
        ("/a/b.png: 3", ""),
        ("", ""),
    ],
)
def test_a_single_argument_is_a_whole_message(message, parameter):
    error = ParameterError(message)
    assert str(error) == message
    assert parts(error)[1:3] == (parameter, "")
    assert not error.has_got


def test_the_same_error_about_another_name():
    error = ParameterError("curvature", "0 to 1", 1.2, "take less")
    renamed = error.renamed("aperture.blade_curvature")
    assert str(renamed) == "aperture.blade_curvature: expected 0 to 1, got 1.2; take less"
    assert parts(renamed)[1:] == ("aperture.blade_curvature", *parts(error)[2:])
    assert str(error) == "curvature: expected 0 to 1, got 1.2; take less"
    assert type(renamed) is ParameterError
    shown = ParameterError("max_memory", "at least 9 MB", 10**6, shown="1 MB").renamed("memory")
    assert str(shown) == "memory: expected at least 9 MB, got 1 MB"
    assert str(ParameterError("blur: expected 0").renamed("--blur")) == "--blur: expected 0"
    assert str(ParameterError("--a needs --b").renamed("a")) == "a: --a needs --b"


def test_names_in_back_quotes_are_kept_for_whoever_shows_them():
    error = ParameterError("defocus", "either this, or `disparity`", None, "give `focus.blur`")
    assert str(error) == "defocus: expected either this, or `disparity`, got None; give `focus.blur`"
    assert "`focus.blur`" in error.remedy


class NarrowError(ParameterError):
    def __init__(self):
        super().__init__("blur", "a number", "x")


@pytest.mark.parametrize(
    "error",
    [
        ParameterError("curvature", "0 to 1", 1.2, "take less"),
        ParameterError("curvature", "a number", None),
        ParameterError("curvature", "a number", (1, [2.5, "x"])),
        ParameterError("curvature", "a number"),
        ParameterError("memory", "more", 3, shown="3 MB"),
        ParameterError("--blur: expected 0 to 1"),
        ParameterError("curvature", "0 to 1", 1.2).renamed("blade_curvature"),
        NarrowError(),
    ],
    ids=str,
)
@pytest.mark.parametrize(
    "way", [copy.copy, copy.deepcopy, lambda error: pickle.loads(pickle.dumps(error))], ids=range(3)
)
def test_copies_and_pickles_are_the_same(error, way):
    twin = way(error)
    assert type(twin) is type(error)
    assert parts(twin) == parts(error)
    assert parts(twin.renamed("x")) == parts(error.renamed("x"))
    assert twin.args == error.args


def test_notes_are_pickled_too():
    error = ParameterError("blur", "a number", "x")
    error.add_note("of frame 3")
    assert pickle.loads(pickle.dumps(error)).__notes__ == ["of frame 3"]


def test_what_cannot_be_pickled_becomes_its_text():
    error = ParameterError("curve", "a field map", lambda x: x)
    assert copy.copy(error).got is error.got
    sent = pickle.loads(pickle.dumps(error))
    assert str(sent) == str(error)
    assert "lambda" in sent.got
    assert pickle.loads(pickle.dumps(ParameterError("x", "less", np.float32(0.5)))).got == 0.5
    big = ParameterError("x", "less", np.zeros((900, 900)))
    assert len(pickle.dumps(big)) < 1000


def fail(value):
    raise ParameterError("blur", "a number", value, "give `blur`")


def test_errors_cross_process_borders():
    with ProcessPoolExecutor(1) as pool, pytest.raises(ParameterError) as caught:
        pool.submit(fail, "x").result()
    assert parts(caught.value) == parts(ParameterError("blur", "a number", "x", "give `blur`"))


def test_a_lens_error_may_name_a_field():
    assert LensError("cannot focus").parameter == ""
    error = pickle.loads(pickle.dumps(LensError("f_number: expected more than 0, got 0", "f_number")))
    assert (str(error), error.parameter) == ("f_number: expected more than 0, got 0", "f_number")


@pytest.mark.parametrize("kind", [ImageFileError, ParameterError, LensError])
def test_names_with_line_breaks_are_printed_in_one_line(kind):
    assert str(kind("a.exr: found G\n\x01, é; write R")) == "a.exr: found G \\x01, é; write R"

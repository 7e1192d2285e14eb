"""Arguments as kernels take them. Authority: numba's own type names and calling convention."""

import ctypes
from typing import NamedTuple

import numpy as np
import pytest
from numba import typeof
from numba.core.registry import cpu_target

from bokehnet.precompiled.arguments import UnsupportedArgument, c_types, describe, flatten


class Pair(NamedTuple):
    values: np.ndarray
    count: int


ARRAY = np.zeros((4, 6), np.float32)
FROZEN = np.zeros(3)
FROZEN.flags.writeable = False

KNOWN = [
    (ARRAY, "f4[2C]"),
    (ARRAY.T, "f4[2F]"),
    (ARRAY[:, ::2], "f4[2A]"),
    (FROZEN, "f8[1Cr]"),
    (np.zeros((1, 3), bool), "b1[2C]"),
    (np.zeros(0, np.uint64), "u8[1C]"),
    (3, "i8"),
    (-(2**63), "i8"),
    (True, "b1"),
    (2.5, "f8"),
    (np.float32(2), "f4"),
    (np.int16(2), "i2"),
    (np.bool_(True), "b1"),
    (None, "None"),
    ((1.0, 2.0), "(f8,f8)"),
    (Pair(ARRAY, 2), "Pair(f4[2C],i8)"),
    ((Pair(FROZEN, 2), None), "(Pair(f8[1Cr],i8),None)"),
]


@pytest.mark.parametrize(("value", "word"), KNOWN, ids=[word for _, word in KNOWN])
def test_types_have_words(value, word):
    assert describe(value) == word


@pytest.mark.parametrize("value", [value for value, _ in KNOWN], ids=[word for _, word in KNOWN])
def test_arguments_match_the_signature_of_numba(value):
    """Authority: the LLVM function type that numba gives a function of this argument."""
    context = cpu_target.target_context
    selected = context.call_conv.get_function_type(typeof(None), (typeof(value),)).args[2:]
    names = ["ptr" if str(kind).endswith("*") else str(kind) for kind in selected]
    flat: list = []
    flatten((value,), flat)
    kinds = c_types(f"({describe(value)})")
    assert len(flat) == len(kinds) == len(names)
    sizes = {"ptr": 8, "i8": 1, "float": 4, "double": 8, "i64": 8, "i16": 2}
    assert [ctypes.sizeof(kind) for kind in kinds] == [sizes[name] for name in names]
    assert [kind is ctypes.c_void_p for kind in kinds] == [name == "ptr" for name in names]


def test_arrays_are_handed_over_with_place_shape_and_strides():
    """Authority: NumPy's own description of a view."""
    view, flat = ARRAY[1:, ::2], []
    flatten((view,), flat)
    assert flat == [None, None, 9, 4, view.ctypes.data, *view.shape, *view.strides]


@pytest.mark.parametrize(
    "value",
    [
        "word",
        2**63,
        [1, 2],
        np.zeros(3, ">f4"),
        np.zeros(3, np.complex64),
        np.zeros(13, np.uint8)[1:].view(np.float32),
        np.ma.zeros(3),
        {"a": 1},
    ],
    ids=repr,
)
def test_other_cases_stay_with_the_compiler(value):
    with pytest.raises(UnsupportedArgument):
        describe(value)
    with pytest.raises(UnsupportedArgument):
        describe((1, value))

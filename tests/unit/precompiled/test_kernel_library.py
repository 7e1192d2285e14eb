"""Precompiled kernels: argument types equal those of numba, and kernels that fail to compile are reported."""

import json

import numpy as np
import pytest
from numba import typeof

from bokehnet.classical.layered.march.defocus_bins import DefocusBins
from bokehnet.precompiled.arguments import describe
from tools.kernel_library import PACKAGE, argument_types, build, read_signatures

FROZEN = np.zeros(3)
FROZEN.flags.writeable = False
BINS = DefocusBins(*[np.zeros((2, 2), kind) for kind in (np.uint64, bool, np.uint64)], 1.0, 2.0)


@pytest.mark.parametrize(
    "value",
    [
        np.zeros((4, 6), np.float32),
        np.zeros((4, 6), np.float32).T,
        np.zeros((4, 6), np.uint8)[:, ::2],
        np.zeros(2, bool),
        FROZEN,
        3,
        2.5,
        True,
        np.float32(1),
        None,
        (1.0, 2.0),
        (1.0, 2),
        ((1.0, (2, 3)), None),
        BINS,
        (BINS, 1),
    ],
    ids=describe,
)
def test_descriptions_map_to_the_types_of_numba(value):
    """Authority: ``numba.typeof``."""
    assert argument_types(f"({describe(value)})") == (typeof(value),)


def test_kernels_that_fail_to_compile_are_reported_and_left_to_numba(tmp_path):
    signatures = [
        ("error_map._of_another_name", "(f4[2C])"),
        ("of_another_name._cover_discs", "(f4[2C])"),
        ("error_map._cover_discs", "(None)"),
        ("error_map._cover_discs", "(OfAnotherName(f8,i8))"),
    ]
    left = build(tmp_path, signatures, processes=1)
    assert len(left) == len(signatures)
    assert all(any(line.startswith(name) for line in left) for name, _ in signatures)
    assert json.loads((tmp_path / "kernels.json").read_text("utf-8"))["kernels"] == {}


def test_short_names_of_listed_modules_are_unique():
    """The build finds a module by its last component, so that moved packages keep their entries."""
    stems = [
        path.stem for path in PACKAGE.rglob("*.py") if "bokehnet.kernels import" in path.read_text("utf-8")
    ]
    listed = {name.partition(".")[0] for name, _ in read_signatures()}
    assert sorted(name for name in listed if stems.count(name) != 1) == []

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.errors import ConfigError, ParameterError
from bokehnet.rendering.sequence import Pull, read_pull


def test_focus_moves_evenly_in_disparity():
    """Authority: blur radius is linear in 1/z: half-way from 1 m to infinity is 2 m."""
    pull = Pull(keys={"focus_distance": [(1001, 1.0), (1005, math.inf)]})
    inverse = [1 / pull.at(frame)["focus_distance"] for frame in range(1001, 1006)]
    assert_allclose(inverse, [1, 0.75, 0.5, 0.25, 0], atol=1e-15)
    assert pull.at(1003) == {"focus_distance": 2.0}


def test_the_aperture_opens_evenly_in_blur():
    """Authority: the blur radius is proportional to 1/N."""
    pull = Pull(keys={"f_number": [(0, 8.0), (4, 2.0)]})
    assert_allclose(np.diff([1 / pull.at(frame)["f_number"] for frame in range(5)]), 3 / 8 / 4)


def test_relative_numbers_are_linear_and_keys_are_exact_and_ends_stay():
    pull = Pull(keys={"focus": [(10, 0.1), (20, 0.7), (30, 0.3)], "blur": [(15, 40.0)]})
    assert pull.at(15) == {"focus": pytest.approx(0.4), "blur": 40.0}
    assert [pull.at(frame)["focus"] for frame in (10, 20, 30)] == [0.1, 0.7, 0.3]
    assert [pull.at(frame)["focus"] for frame in (-5, 99)] == [0.1, 0.3]


def test_a_distance_that_is_none_is_told():
    with pytest.raises(ParameterError, match="above 0, got -1"):
        Pull(keys={"focus_distance": [(0, -1.0), (4, 2.0)]}).at(2)


def test_a_file_holds_keys_and_empty_cells_are_none(tmp_path):
    path = tmp_path / "pull.csv"
    path.write_text("\ufefffocus_distance, frame, f_number\n2.5,1010,\n1,1001,2\ninf,1020,4\n", "utf-8")
    pull = read_pull(path)
    assert pull.keys == {
        "focus_distance": [(1001, 1.0), (1010, 2.5), (1020, math.inf)],
        "f_number": [(1001, 2.0), (1020, 4.0)],
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "found nothing"),
        ("frame\n1\n", "found frame"),
        ("focus\n1\n", "found focus"),
        ("frame,colour\n1,2\n", "found frame, colour"),
        ("frame,focus,focus\n1,2,3\n", "found frame, focus, focus"),
        ("frame,focus\n1,near\n", "line 2: expected a whole frame"),
        ("frame,focus\n1.5,0.2\n", "line 2: expected a whole frame"),
        ("frame,focus\n,0.2\n", "line 2: expected a whole frame"),
        ("frame,focus\n1,nan\n", "line 2: expected one number"),
        ("frame,focus\n1,0.2,0.3\n", "line 2: expected one number"),
        ("frame,focus\n1,0.2\n1,0.3\n", "line 3: frame 1 stands there twice"),
        ("frame,focus,blur\n1,0.2,\n2\n", "found none for blur"),
        ("frame,focus\n", "found none for focus"),
        ("\x00\x01", "expected the column frame"),
    ],
)
def test_a_file_that_is_none_is_told(tmp_path, text, words):
    path = tmp_path / "pull.csv"
    path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        read_pull(path)


def test_a_file_that_cannot_be_read_is_told(tmp_path):
    with pytest.raises(ConfigError, match="No such file"):
        read_pull(tmp_path / "missing.csv")
    (tmp_path / "bytes.csv").write_bytes(b"frame,focus\n1,\xff\n")
    with pytest.raises(ConfigError, match="expected a CSV file"):
        read_pull(tmp_path / "bytes.csv")

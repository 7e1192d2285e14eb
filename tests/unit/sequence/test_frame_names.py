from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bokehnet.errors import ParameterError
from bokehnet.sequence.frame_names import format_frames, frame_path, is_pattern, parse_frames


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("7", (7,)),
        ("1001-1003", (1001, 1002, 1003)),
        ("1-10x4", (1, 5, 9)),
        ("20-22, 5,21", (5, 20, 21, 22)),
        ("0-0", (0,)),
    ],
)
def test_frames_are_read_as_people_write_them(text, frames):
    assert parse_frames(text) == frames


@pytest.mark.parametrize(
    "text", ["", "a", "1-", "-5", "1-2-3", "5-1", "1-9x0", "1-9x", "1.5", "1..9", "1,,2"]
)
def test_unknown_words_are_reported(text):
    with pytest.raises(ParameterError, match=r"^frames: expected"):
        parse_frames(text)


def test_a_slip_of_digits_does_not_fill_the_memory():
    with pytest.raises(ParameterError, match="at most 1000000"):
        parse_frames("1-999999999")


@given(st.sets(st.integers(0, 10_000), min_size=1, max_size=50))
def test_format_is_the_inverse_of_parse(frames):
    assert parse_frames(format_frames(frames)) == tuple(sorted(frames))


@pytest.mark.parametrize(
    ("name", "frame", "expected"),
    [
        ("shot.####.exr", 12, "shot.0012.exr"),
        ("shot.%04d.exr", 12, "shot.0012.exr"),
        ("shot.%d.exr", 12, "shot.12.exr"),
        ("shot.##.exr", 1234, "shot.1234.exr"),
        ("take #2.####.exr", 5, "take #2.0005.exr"),
        ("still.exr", 5, "still.exr"),
        ("100%.exr", 5, "100%.exr"),
    ],
)
def test_the_last_place_in_the_name_takes_the_number(name, frame, expected):
    path = Path("####") / name
    assert frame_path(path, frame) == Path("####") / expected
    assert is_pattern(path) == (expected != name)

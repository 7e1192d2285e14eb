import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.errors import ConfigError, ParameterError
from bokehnet.sequence.sequence import (
    Pull,
    SequenceSettings,
    input_files,
    make_pull,
    read_pull,
    settings_at_frame,
)
from bokehnet.settings.settings import (
    CameraSettings,
    FocusSettings,
    InputSettings,
    OutputSettings,
    RenderSettings,
)


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


def test_an_invalid_distance_is_reported():
    with pytest.raises(ParameterError, match="above 0, got -1"):
        Pull(keys={"focus_distance": [(0, -1.0), (4, 2.0)]}).at(2)


def test_a_file_holds_keys_and_no_empty_cells(tmp_path):
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
        ("frame,focus\n1,0.2\n1,0.3\n", "line 3: frame 1 occurs twice"),
        ("frame,focus,blur\n1,0.2,\n2\n", "found none for blur"),
        ("frame,focus\n", "found none for focus"),
        ("\x00\x01", "expected the column frame"),
    ],
)
def test_an_invalid_file_is_reported(tmp_path, text, words):
    path = tmp_path / "pull.csv"
    path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        read_pull(path)


def test_a_file_that_cannot_be_read_is_reported(tmp_path):
    with pytest.raises(ConfigError, match="No such file"):
        read_pull(tmp_path / "missing.csv")
    (tmp_path / "bytes.csv").write_bytes(b"frame,focus\n1,\xff\n")
    with pytest.raises(ConfigError, match="expected a CSV file"):
        read_pull(tmp_path / "bytes.csv")


def test_ends_make_a_pull_from_the_first_frame_to_the_last(tmp_path):
    ends = SequenceSettings(focus_from=1, focus_to=math.inf, f_number_from=8, f_number_to=2)
    result = make_pull([3, 5, 7], ends, metric=True)
    assert result.keys == {"focus_distance": [(3, 1), (7, math.inf)], "f_number": [(3, 8), (7, 2)]}
    relative = make_pull(
        [3], SequenceSettings(focus_from=0.1, focus_to=0.9, blur_from=2, blur_to=4), metric=False
    )
    assert relative.keys == {"focus": [(3, 0.1), (3, 0.9)], "blur": [(3, 2), (3, 4)]}
    assert make_pull([1, 2], SequenceSettings(), metric=True).at(1) == {}
    (tmp_path / "pull.csv").write_text("frame,blur\n1,5\n")
    assert make_pull([1], SequenceSettings(file=tmp_path / "pull.csv"), metric=False).at(1) == {"blur": 5}


@pytest.mark.parametrize(
    ("settings", "parameter", "words"),
    [
        (
            {"focus_from": 1},
            "sequence.focus_to",
            "both `sequence.focus_from` and `sequence.focus_to`, got one",
        ),
        ({"blur_to": 1}, "sequence.blur_from", "both `sequence.blur_from` and `sequence.blur_to`"),
        (
            {"file": "a.csv", "blur_from": 1, "blur_to": 2},
            "sequence.file",
            "either `sequence.file`",
        ),
    ],
)
def test_half_a_pull_is_reported(settings, parameter, words):
    with pytest.raises(ParameterError) as caught:
        make_pull([1, 2], SequenceSettings(**settings), metric=True)
    assert caught.value.parameter == parameter
    assert words in str(caught.value)


def test_a_frame_has_its_files_and_what_is_pulled_and_everything_else_stays():
    shot = RenderSettings(input=InputSettings(disparity="z.##.png"), camera=CameraSettings(blur=9))
    result = settings_at_frame(shot, 7, Pull(keys={"focus": [(1, 0.1), (11, 0.6)]}))
    assert str(result.input.disparity) == "z.07.png"
    assert result.depth.as_stored  # frames are treated alike
    assert (result.focus.value, result.camera.blur) == (pytest.approx(0.4), 9)
    still = RenderSettings(input=InputSettings(disparity="z.png"), output=OutputSettings(save_maps="m"))
    assert settings_at_frame(still, 7) == still
    assert input_files(result).keys() == {"disparity"}
    assert input_files(RenderSettings(input=InputSettings(defocus="d.exr"))).keys() == {"defocus"}


@pytest.mark.parametrize(
    ("name", "settings", "value", "parameter"),
    [
        ("focus", {"focus": FocusSettings(value=0.5)}, 0.5, "focus.value"),
        ("blur", {"camera": CameraSettings(blur=3)}, 5, "camera.blur"),
        ("f_number", {"camera": CameraSettings(f_number=3)}, 5, "camera.f_number"),
        ("focus_distance", {"focus": FocusSettings(at=(1, 1))}, 5, "focus.at"),
        ("focus", {}, 1.5, "focus.value"),
        ("blur", {}, -1, "camera.blur"),
        ("f_number", {}, 0, "camera.f_number"),
        ("focus_distance", {}, -math.inf, "focus.distance"),
        ("focus_distance", {}, math.nan, "focus.distance"),
    ],
)
def test_a_pull_is_checked_as_the_settings_that_it_moves(name, settings, value, parameter):
    with pytest.raises(ParameterError) as caught:
        settings_at_frame(RenderSettings(**settings), 1, Pull(keys={name: [(1, value)]}))
    assert caught.value.parameter == parameter

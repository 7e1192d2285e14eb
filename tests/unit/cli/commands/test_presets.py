"""``bokehnet presets`` and ``--preset``. Authority: the options that they stand for, given one by one."""

from pathlib import Path

import numpy as np
import pytest

from bokehnet.cli.app import run
from bokehnet.io.image import read_image, write_image
from bokehnet.settings.preset import load_preset, presets
from bokehnet.settings.settings import all_settings


@pytest.fixture
def scene(tmp_path):
    rng = np.random.default_rng(0)
    write_image(tmp_path / "in.png", rng.random((48, 64, 3)).astype(np.float32))
    write_image(tmp_path / "map.png", np.tile(np.linspace(0, 1, 64)[None, :, None], (48, 1, 3)))
    return tmp_path


def rendered(scene: Path, *options: str) -> np.ndarray:
    words = ["render", str(scene / "in.png"), "--disparity", str(scene / "map.png"), "--blur", "9"]
    words += ["--focus", "0.5", "--repair-disparity", "off", "-o", str(scene / "out.exr"), *options]
    assert run(words) == 0
    return read_image(scene / "out.exr")


def test_the_list_describes_each_entry(capsys):
    assert run(["presets"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(presets())
    for name, line in zip(presets(), lines, strict=True):
        assert line.split(None, 1) == [name, load_preset(name).description]


@pytest.mark.parametrize("name", presets())
def test_a_preset_is_the_options_that_it_names(scene, name):
    values = load_preset(name).values
    flags = {(known.group, known.name): known.flag for known in all_settings().values()}
    words = [
        word
        for group, fields in values.items()
        for field, value in fields.items()
        for word in spelled(flags[group, field], value)
    ]
    picture = rendered(scene, "--preset", name)
    np.testing.assert_array_equal(picture, rendered(scene, *words))
    assert np.abs(picture - rendered(scene)).max() > 0


def spelled(option: str, value) -> list[str]:
    return [f"--{option}"] if value is True else [f"--{option}", str(value)]


def test_an_option_overrides_it(scene):
    preset = scene / "mine.toml"
    preset.write_text('description = "mine"\nblades = 5\ncats-eye = 0.5\n')
    picture = rendered(scene, "--preset", str(preset), "--blades", "7")
    np.testing.assert_array_equal(picture, rendered(scene, "--blades", "7", "--cats-eye", "0.5"))


def test_what_a_preset_prints_is_a_preset(scene, capsys):
    assert run(["presets", "anamorphic"]) == 0
    copy = scene / "copy.toml"
    copy.write_text(capsys.readouterr().out)
    preset, shipped = load_preset(copy), load_preset("anamorphic")
    assert (preset.description, preset.values) == (shipped.description, shipped.values)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("blads = 5\n", "unknown option 'blads'; did you mean blades"),
        ("blur = 5\n", "unknown option 'blur'; a preset can set aberration-table"),
        ("[camera]\nblur = 5\n", "unknown option 'camera.blur'; a preset can set "),
        ("blades = [5]\n", "--blades: expected 0 (disc) or 3 to 16, got [5]"),
        ("blades = 2024-05-01\n", "blades: expected a number, a text, true or a list"),
        ("blades = \n", "expected TOML, found an error"),
        ('blades = "many"\n', "--blades: expected 0 (disc) or 3 to 16, got 'many'"),
        ("blades = true\n", "--blades: expected 0 (disc) or 3 to 16, got True"),
        ("rim = nan\n", "--rim: expected -1 to 1, got nan"),
        ("blade-curvature = 0.5\n", "--blade-curvature: expected --blades for it to act on"),
        ("description = 3\n", "description: expected a text"),
    ],
)
def test_mistakes_take_one_line_and_write_nothing(scene, capsys, text, message):
    preset = scene / "mine.toml"
    preset.write_text(text)
    words = ["render", str(scene / "in.png"), "--disparity", str(scene / "map.png"), "--blur", "9"]
    assert run([*words, "--focus", "0.5", "-o", str(scene / "out.png"), "--preset", str(preset)]) == 1
    error = capsys.readouterr().err
    assert message in error
    assert len(error.strip().splitlines()) == 1
    assert not (scene / "out.png").exists()


@pytest.mark.parametrize("command", [["presets"], ["render", "a.png", "-o", "out.png", "--preset"]])
def test_an_unknown_name_lists_the_known_ones(capsys, command):
    assert run([*command, "nothing"]) == 1
    assert "unknown preset 'nothing': expected a .toml file or one of anamorphic" in capsys.readouterr().err

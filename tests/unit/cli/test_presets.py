"""Presets. Authority: the options that they stand for, given one by one."""

import inspect
from pathlib import Path

import numpy as np
import pytest
from bokehnet.cli.preset_option import look_options

import bokehnet
from bokehnet.cli.app import app, run
from bokehnet.cli.render import render
from bokehnet.io.image import read_image, write_image
from bokehnet.rendering.preset import preset_path, read_preset
from bokehnet.rendering.preset import presets as preset_names


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


def valid_options() -> dict[str, str]:
    import click
    import typer

    command = typer.main.get_command(app).commands["render"]
    return look_options(click.Context(command))


def test_there_are_at_least_ten_and_each_says_what_it_is(capsys):
    assert run(["presets"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(preset_names()) >= 10
    for name, line in zip(preset_names(), lines, strict=True):
        preset = read_preset(name, valid_options())
        assert line.split(None, 1) == [name, preset.description]
        assert preset.options
        assert 20 < len(preset.description) < 100


@pytest.mark.parametrize("name", preset_names())
def test_a_preset_is_the_options_that_it_names(scene, name):
    options = read_preset(name, valid_options()).options
    words = [w for option, value in options.items() for w in spelled(option, value)]
    found = rendered(scene, "--preset", name)
    np.testing.assert_array_equal(found, rendered(scene, *words))
    assert np.abs(found - rendered(scene)).max() > 0


def spelled(option: str, value) -> list[str]:
    return [f"--{option}"] if value is True else [f"--{option}", str(value)]


def test_an_option_beside_it_prevails(scene):
    preset = scene / "mine.toml"
    preset.write_text('description = "mine"\nblades = 5\ncats-eye = 0.5\n')
    found = rendered(scene, "--preset", str(preset), "--blades", "7")
    np.testing.assert_array_equal(found, rendered(scene, "--blades", "7", "--cats-eye", "0.5"))


def test_what_a_preset_prints_is_a_preset(scene, capsys):
    assert run(["presets", "anamorphic"]) == 0
    copy = scene / "copy.toml"
    copy.write_text(capsys.readouterr().out)
    assert read_preset(str(copy), valid_options()) == read_preset("anamorphic", valid_options())


def test_a_look_has_nothing_of_the_scene():
    names = valid_options()
    assert {"cats-eye", "lens", "grain", "engine", "gamma", "tilt-x"} <= names.keys()
    assert not {"blur", "focus", "disparity", "output", "frames", "help", "preset", "f-number"} & names.keys()
    assert set(names.values()) <= set(inspect.signature(render).parameters)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("blads = 5\n", "unknown option 'blads'; a preset can set aberrations"),
        ("blades = [5]\n", "blades: expected a number, a text or true"),
        ("blades = \n", "expected TOML, found an error"),
        ('blades = "many"\n', "'--blades'"),
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


def test_an_unknown_name_lists_the_known_ones(capsys):
    assert run(["presets", "nothing"]) == 1
    assert "unknown preset 'nothing': expected a .toml file or one of anamorphic" in capsys.readouterr().err


def test_presets_travel_with_the_package():
    folder = Path(bokehnet.__file__).parent / "cli" / "presets"
    assert {preset_path(name).parent for name in preset_names()} == {folder}

"""Looks in TOML files."""

from pathlib import Path

import pytest

import bokehnet
from bokehnet.errors import ConfigError, ParameterError
from bokehnet.settings.preset import load_preset, preset_file, presets
from bokehnet.settings.settings import (
    ApertureSettings,
    CameraSettings,
    EngineSettings,
    RenderSettings,
    all_settings,
    settings_by_flag,
)


def test_there_are_at_least_ten_and_each_has_a_description():
    assert len(presets()) >= 10
    assert presets() == sorted(presets())
    for name in presets():
        preset = load_preset(name)
        assert preset.name == name
        assert 20 < len(preset.description) < 100
        assert preset.values
        assert preset.over() != RenderSettings()


def test_a_look_has_nothing_of_the_scene():
    """Authority: the list of flags that a preset could set before there were groups."""
    looks = {flag for flag, known in settings_by_flag().items() if known.allowed_in_preset}
    assert {"cats-eye", "lens", "grain", "engine", "gamma", "tilt-x"} <= looks
    assert not {"blur", "focus", "disparity", "f-number", "weights", "max-memory", "save-maps"} & looks
    assert not {
        path for path, known in all_settings().items() if known.allowed_in_preset and known.flag is None
    }


def test_what_a_look_does_not_name_stays(tmp_path):
    look = tmp_path / "look.toml"
    look.write_text("cats-eye = 0.5\n[lens]\ncoma = 3\n")
    before = RenderSettings(camera=CameraSettings(blur=9), aperture=ApertureSettings(blades=7))
    after = load_preset(look).over(before)
    assert (after.camera, after.aperture) == (before.camera, ApertureSettings(blades=7, cats_eye=0.5))
    assert after.lens.coma == 3


def test_groups_and_flags_say_the_same(tmp_path):
    flat, nested = tmp_path / "flat.toml", tmp_path / "nested.toml"
    flat.write_text('rim = 0.4\ndisc-grain = 1\nfringe-glass = "F2"\naxial-fringe = 2\n')
    nested.write_text("[aperture]\nspherical_profile = 0.4\ngrain = 1\n[color]\naxial = 2\nglass = 'F2'\n")
    assert load_preset(flat).over() == load_preset(nested).over()


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        ("blads = 5\n", ConfigError, "unknown option 'blads'; did you mean blades"),
        ("[aperture]\nblads = 5\n", ConfigError, "unknown option 'aperture.blads'"),
        ("[aperture.blades]\nmany = 5\n", ConfigError, "aperture.blades: expected a number, a text, true"),
        ("[camera]\nblur = 5\n", ConfigError, "unknown option 'camera.blur'"),
        ("[depth]\nas_stored = true\n", ConfigError, "unknown option 'depth.as_stored'"),
        ("blades = 1979-05-27\n", ConfigError, "blades: expected a number, a text, true or a list"),
        ("aperture = 3\n", ConfigError, "unknown option 'aperture'"),
        ("description = 3\n", ConfigError, "description: expected a text, got 3"),
        ("\x00", ConfigError, "expected TOML, found an error"),
    ],
)
def test_a_file_without_a_look_is_reported(tmp_path, text, kind, words):
    path = tmp_path / "look.toml"
    path.write_text(text)
    with pytest.raises(kind, match=words):
        load_preset(path)


@pytest.mark.parametrize(
    ("text", "parameter"),
    [
        ("blades = 2\n", "aperture.blades"),
        ('blades = "many"\n', "aperture.blades"),
        ("blades = [5]\n", "aperture.blades"),
        ("blade-curvature = 1\n", "aperture.curvature"),
    ],
)
def test_a_none_value_is_reported_by_the_user_of_the_look(tmp_path, text, parameter):
    path = tmp_path / "look.toml"
    path.write_text(text)
    with pytest.raises(ParameterError) as caught:
        load_preset(path).over()
    assert caught.value.parameter == parameter


def test_a_look_that_follows_rays_refuses_an_engine_that_does_not():
    with pytest.raises(ParameterError, match=r"engine.name. rays or hybrid"):
        load_preset("petzval-swirl").over(RenderSettings(engine=EngineSettings(name="scatter")))


def test_a_file_that_cannot_be_read_is_reported(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot read preset .*missing.toml"):
        load_preset(tmp_path / "missing.toml")
    with pytest.raises(ConfigError, match=r"unknown preset 'nothing'.* one of anamorphic"):
        load_preset("nothing")
    (tmp_path / "bytes.toml").write_bytes(b'description = "\xff"')
    with pytest.raises(ConfigError, match="expected TOML"):
        load_preset(tmp_path / "bytes.toml")


def test_presets_travel_with_the_package():
    folder = Path(bokehnet.__file__).parent / "settings" / "presets"
    assert {preset_file(name).parent for name in presets()} == {folder}

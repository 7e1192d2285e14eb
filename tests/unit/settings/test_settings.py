"""Every field of the settings: what it takes, what it refuses, and how files hold it."""

import dataclasses
import math
import pickle
import typing
from pathlib import Path

import numpy as np
import pytest

from bokehnet.errors import ConfigError, ParameterError
from bokehnet.sequence.sequence import SequenceSettings
from bokehnet.settings.fields import field_settings, from_plain
from bokehnet.settings.settings import (
    ApertureSettings,
    CameraSettings,
    ColorSettings,
    DepthSettings,
    FocusSettings,
    InputSettings,
    LensSettings,
    RenderSettings,
    all_settings,
    group_types,
    settings_by_flag,
)
from bokehnet.settings.settings_file import load_settings, save_settings, settings_from_table

GROUPS = [*group_types(), SequenceSettings]
FIELDS = [(group, known) for group in GROUPS for known in field_settings(group).values()]
HUGE = 10**400

# Values that no field takes, and some that are wrong for most.
NEVER = [object(), {}, b"1", 1j, math.nan, np.nan, np.array([[math.nan]]), set(), Path, float, (), [None]]
NO_NUMBER = [*NEVER, "1", "wide", "", [], [1], (1.0,), True, False, np.True_, HUGE, -HUGE, Path("a")]
WRONG = {
    "number": NO_NUMBER,
    "truth": [*NEVER, "true", "", 0, 1, 1.0, [], math.inf, np.float64(1)],
    "choice": [*NEVER, "nonsense", "", 1, True, [], math.inf, Path("m")],
    "text": [*NEVER, 1, 1.0, True, [], ["a"], math.inf, Path("a")],
    "path": [*NEVER, 1, 1.0, True, [], ["a"], math.inf],
    "numbers": [*NEVER, 1, True, [], {1: 2}, ("1", "2"), (True, True), (math.nan,) * 2, (1j,), [[]], (HUGE,)],
}


def kind(known):
    """Return the sort of values of a field from its type alone."""
    if known.choices:
        return "choice"
    if "tuple" in str(known.type):
        return "numbers"
    if "Literal" in str(known.type):  # a number or one of some words
        return "number"
    return {float: "number", int: "number", bool: "truth", str: "text", Path: "path"}[known.type]


def refused(group, known, value):
    with pytest.raises(ParameterError) as caught:
        group(**{known.name: value})
    error = caught.value
    assert error.parameter == known.path
    assert error.expected
    assert error.got is value
    assert str(error).startswith(f"{known.path}: expected {error.expected}")
    assert "\n" not in str(error)
    assert pickle.loads(pickle.dumps(error)).parameter == known.path


@pytest.mark.parametrize(("group", "known"), FIELDS, ids=lambda item: getattr(item, "path", None))
def test_a_value_of_another_type_is_refused_by_the_name_of_the_field(group, known):
    for value in WRONG[kind(known)]:
        refused(group, known, value)
    if known.default is not None:
        refused(group, known, None)


@pytest.mark.parametrize(("group", "known"), FIELDS, ids=lambda item: getattr(item, "path", None))
def test_infinity_is_a_value_only_if_the_field_allows_it(group, known):
    """Authority: ``Setting.infinite``. Below 0 infinity needs a field without a lower bound as well."""
    for value in (math.inf, -math.inf):
        original = {"number": value, "numbers": (value, 1.0)}.get(kind(known))
        if original is None:
            continue
        bounded = known.low is not None or known.above is not None
        if known.infinite and not (value < 0 and bounded):
            assert group(**{known.name: original}) == group(**{known.name: original})
        else:
            refused(group, known, original)


@pytest.mark.parametrize(("group", "known"), FIELDS, ids=lambda item: getattr(item, "path", None))
def test_each_bound_holds_on_its_own_side(group, known):
    """Authority: the bounds of the field; the number next to a bound is found by NumPy."""

    def beside(bound, step):
        return bound + step if known.type is int else float(np.nextafter(bound, step * math.inf))

    def given(number):
        return number if kind(known) == "number" else (number, 1.0)

    for bound, outwards in ((known.low, -1), (known.high, 1)):
        if bound is None or kind(known) not in ("number", "numbers"):
            continue
        whole = int(bound) if known.type is int else bound
        if known.type is int or kind(known) == "number":
            assert known.checked(whole) == bound
        if "int" not in str(known.type) or kind(known) == "number":
            refused(group, known, given(beside(whole, outwards)))
    for bound, inwards in ((known.above, 1), (known.below, -1)):
        if bound is not None:
            refused(group, known, bound)
            assert known.checked(beside(bound, inwards)) == beside(bound, inwards)


@pytest.mark.parametrize(
    ("group", "name", "value"),
    [
        (ApertureSettings, "blades", 2),
        (ApertureSettings, "blades", 17),
        (ApertureSettings, "blades", -3),
        (ApertureSettings, "blades", 5.0),
        (DepthSettings, "value_range", (2, 2)),
        (DepthSettings, "value_range", (1, 2, 3)),
        (FocusSettings, "at", (1.5, 2)),
        (FocusSettings, "at", (1, 2, 3)),
        (FocusSettings, "range", (-1, 2)),
        (FocusSettings, "plane", ((1, 1), (2, 2))),
        (FocusSettings, "plane", ((1, 1), (2, 2), (3, "3"))),
        (ColorSettings, "equaliser", (1, -2)),
        (ColorSettings, "equaliser", ()),
        (SequenceSettings, "frames", (1, -2)),
        (SequenceSettings, "frames", (1.5,)),
    ],
)
def test_values_that_only_look_right_are_refused(group, name, value):
    refused(group, field_settings(group)[name], value)


# A valid value of each field that is not its default, in sets that go together.
VALID = [
    {
        "input": {"disparity": "a b.png", "channel": "Z", "matte": "m.png"},
        "depth": {
            "invert": True, "value_range": (-1, 2.5), "as_stored": True, "resize": True, "mixed": "on",
            "repair": "off", "pixel_filter": "gaussian:1.5", "coding": "turbo", "no_data": -1,
            "holes": "error",
        },
        "focus": {"value": 0.3, "tilt_x": -20, "tilt_y": 4.5},
        "camera": {"blur": 60},
        "aperture": {
            "blades": 7, "curvature": 0.25, "rotation": -15, "squeeze": 0.5, "cats_eye": 1.5,
            "image": 'a "quoted" \\ name\n.png', "spherical_profile": -0.5, "obstruction": 0.3, "onion": 0.5,
            "onion_rings": 7, "grain": 1, "grain_seed": 2**40,
        },
        "lens": {
            "name": "double_gauss", "aberrations": "seidel", "engine": "map", "f_number": 4,
            "distortion": True, "focusing": "paraxial", "vignetting": False, "table": "t.csv",
            "copy_to_copy": 2.5, "copy_seed": 7,
            "spherical": 3, "coma": -3, "astigmatism": 1e-3, "field_curvature": 100,
        },
        "color": {
            "axial": 2, "lateral": -2, "axial_map": "power:2,linear", "lateral_map": "square", "glass": "F2",
            "dispersion": "rgb", "equaliser": (1, 0.5, 3),
        },
        "highlights": {"threshold": 0.9, "gain": 12, "gamma": 2.2},
        "light": {
            "rings": 2.8, "starburst": 16, "pixel_pitch": 4, "ghosts": "ideal", "lamps": 3, "glare": 0.03,
            "glare_core": 1, "glare_slope": 3,
        },
        "effects": {
            "distortion": -0.1, "cos4": 40, "optical_vignetting": 1, "vignette": -2, "vignette_radius": 0,
            "vignette_softness": 0.5, "vignette_roundness": 0.5, "vignette_color_loss": 0.5,
            "grain": 3200, "grain_size": 2,
            "grain_mono": True, "grain_seed": 9,
        },
        "engine": {"name": "hybrid", "weights": "nets", "max_memory": 2**31, "device": "auto"},
        "output": {
            "save_maps": "maps/ü", "color_space": "prophoto", "bits": "16", "quality": 80,
            "subsampling": "4:2:0", "dither": "off", "shoulder": "on", "expected_error": "on",
        },
    },
    {
        "input": {"depth": "a.exr", "supersampled": 4},
        "depth": {"unit": "1/256m", "kind": "ray"},
        "focus": {"distance": math.inf},
        "camera": {"focal_length": 50, "f_number": 1.8, "sensor_width": 36},
        "effects": {"brown": (-0.1, 0.02)},
        "color": {"axial": 1, "equaliser": "gains.txt"},
        "engine": {"name": "rays"},
    },
    {"input": {"disparity": "a.png", "projection": "equirect"}},
    {"input": {"disparity": "a.png", "stereo": "top-bottom"}},
    {"input": {"disparity": "a.png", "color_space": "logc3"}},
    {"input": {"depth": "a.png"}, "depth": {"near": math.inf, "far": 0.1, "kind": "zbuffer"}},
    {"input": {"defocus": "a.exr"}, "highlights": {"strength": 0.5}},
    {"input": {"layers": "a.exr"}},
    {"input": {"depth_model": "a.onnx", "depth_convention": "midas"}, "focus": {"at": (3, -4)}},
    {"input": {"constant_disparity": 0.5}, "focus": {"range": (math.inf, 0.5)}},
    {"focus": {"plane": ((1, 2), (3, 4), (50, 6))}, "camera": {"strength": 80}},
]  # fmt: skip


def test_the_valid_values_name_every_field():
    named = {f"{group}.{field}" for one in VALID for group, fields in one.items() for field in fields}
    assert named == set(all_settings())
    for one in VALID:
        settings = RenderSettings().updated(one)
        assert {(group, name) for group, fields in settings.to_table().items() for name in fields} == {
            (group, name) for group, fields in one.items() for name in fields
        }


@pytest.mark.parametrize("changes", VALID)
def test_a_file_holds_all_that_was_set(tmp_path, changes):
    settings = RenderSettings().updated(changes)
    path = tmp_path / "settings.toml"
    save_settings(path, settings)
    assert load_settings(path) == settings
    assert RenderSettings().updated(settings.to_table()) == settings
    save_settings(tmp_path / "again.toml", load_settings(path))
    assert (tmp_path / "again.toml").read_bytes() == path.read_bytes()


def test_a_file_of_the_defaults_is_empty(tmp_path):
    save_settings(tmp_path / "settings.toml", RenderSettings())
    assert (tmp_path / "settings.toml").read_text() == ""
    assert load_settings(tmp_path / "settings.toml") == RenderSettings()


def test_names_of_files_with_odd_characters_come_back(tmp_path):
    for name in ("a\tb\x7f\x00", "\u2028 \U000e0001", "🙂\\u0041", "'''\"\"\""):
        settings = RenderSettings(input=InputSettings(disparity=name))
        save_settings(tmp_path / "settings.toml", settings)
        assert str(load_settings(tmp_path / "settings.toml").input.disparity) == name


def test_a_file_that_cannot_be_written_is_reported_and_nothing_is_left(tmp_path):
    with pytest.raises(ConfigError):
        save_settings(tmp_path / "no" / "settings.toml", RenderSettings())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "kind", "words"),
    [
        ("blads = 5\n", ConfigError, "unknown option 'blads'; did you mean blades"),
        ("[aperture]\nblads = 5\n", ConfigError, "unknown option 'aperture.blads'"),
        ("[apertures]\nblades = 5\n", ConfigError, "unknown option 'apertures'; did you mean aperture"),
        ("[lights]\nblades = 5\n", ConfigError, "unknown option 'lights'; did you mean light"),
        ("[motor]\nblades = 5\n", ConfigError, "unknown option 'motor'; expected one of aperture, "),
        ("[aperture.blades]\nmany = 5\n", ConfigError, "aperture.blades: expected a number"),
        ("[camera]\nblur = 1979-05-27\n", ConfigError, "camera.blur: expected a number"),
        (
            "[camera]\nblur = -1\n",
            ParameterError,
            "camera.blur: expected a number of at least 0 pixels, got -1",
        ),
        ("[camera]\nblur = '1'\n", ParameterError, "camera.blur"),
        ("[camera]\nblur = nan\n", ParameterError, "camera.blur"),
        ("[camera]\nblur = [1]\n", ParameterError, "camera.blur"),
        ("[depth]\nresize = 1\n", ParameterError, "depth.resize: expected true or false, got 1"),
        ("[depth]\nunit = 'm'\n", ParameterError, "depth.unit: expected `input.depth` for it to act on"),
        ("[camera\n", ConfigError, "expected TOML, found an error"),
        (f"blades = {'1' * 5000}\n", ConfigError, "expected TOML, found an error"),
    ],
)
def test_a_file_that_holds_something_else_is_reported(tmp_path, text, kind, words):
    (tmp_path / "settings.toml").write_text(text)
    with pytest.raises(kind, match=words):
        load_settings(tmp_path / "settings.toml")


def test_a_file_may_use_the_flags_of_the_command_line(tmp_path):
    path = tmp_path / "settings.toml"
    path.write_text(
        'disparity = "a.png"\nfocus-at = "3,4"\ndisparity-range = [0, 2]\nrefine-disparity = "off"\n'
        'max-memory = "1.5G"\nequaliser = "1,2,1"\naxial-fringe = 3\n'
    )
    result = load_settings(path)
    assert (result.focus.at, result.depth.value_range, result.depth.repair) == ((3, 4), (0, 2), "off")
    assert (result.engine.max_memory, result.color.equaliser) == (3 * 2**29, (1, 2, 1))


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("500", 500),
        ("20k", 20480),
        ("1.5G", 3 * 2**29),
        ("2 GiB", 2**31),
        ("3MB", 3 * 2**20),
        ("0", 0),
        ("1056000000", 1056000000),
    ],
)
def test_sizes_are_read_as_people_write_them(text, size):
    assert from_plain(all_settings()["engine.max_memory"], text) == size


@pytest.mark.parametrize("text", ["much", "", "-1", "1e9", "4X", "1.5.2G", "nan", "inf"])
def test_an_invalid_size_is_reported(text):
    with pytest.raises(ParameterError, match=r"engine.max_memory: expected a size such as 500M or 2G"):
        from_plain(all_settings()["engine.max_memory"], text)


def test_unknown_names_are_reported_with_the_known_ones():
    with pytest.raises(ParameterError, match="apertures: expected one of input, depth, focus") as caught:
        RenderSettings().updated({"apertures": {}})
    assert caught.value.parameter == "apertures"
    with pytest.raises(ParameterError, match=r"aperture.blads: expected one of blades, curvature") as caught:
        RenderSettings().updated({"aperture": {"blads": 5}})
    assert caught.value.parameter == "aperture.blads"
    with pytest.raises(ParameterError, match="aperture: expected fields and their values, got 5"):
        RenderSettings().updated({"aperture": 5})


@pytest.mark.parametrize("value", [None, 5, {}, CameraSettings()])
def test_a_group_is_nothing_but_a_group(value):
    with pytest.raises(ParameterError, match="aperture: expected a ApertureSettings"):
        RenderSettings(aperture=value)


def test_changes_leave_the_rest_and_the_original():
    first = RenderSettings(camera=CameraSettings(blur=9))
    second = first.updated({"camera": {"f_number": 2}, "lens": {"coma": 3}})
    assert (second.camera.blur, second.camera.f_number, second.lens.coma) == (9, 2, 3)
    assert first == RenderSettings(camera=CameraSettings(blur=9))
    assert first.updated({}) == first


@pytest.mark.parametrize("changes", VALID)
def test_settings_are_values(changes):
    first, second = RenderSettings().updated(changes), RenderSettings().updated(changes)
    assert first == second
    assert hash(first) == hash(second)
    assert first != RenderSettings()
    copy = pickle.loads(pickle.dumps(first))
    assert copy == first
    assert hash(copy) == hash(first)
    with pytest.raises(dataclasses.FrozenInstanceError):
        first.camera = CameraSettings()


def test_numbers_of_other_kinds_become_pythons_own():
    settings = CameraSettings(blur=np.float32(2), f_number=np.array(4), focal_length=50)
    assert [type(value) for value in (settings.blur, settings.f_number, settings.focal_length)] == [float] * 3
    assert settings == CameraSettings(blur=2, f_number=4, focal_length=50.0)
    assert type(ApertureSettings(blades=np.int64(5)).blades) is int
    assert FocusSettings(at=[np.int32(3), 4]).at == (3, 4)
    assert FocusSettings(plane=[[1, 2], (3, 4), [5, 6]]).plane == ((1, 2), (3, 4), (5, 6))
    assert InputSettings(disparity="a.png").disparity == Path("a.png")


@pytest.mark.parametrize(
    ("changes", "parameter"),
    [
        ({"input": {"disparity": "a", "depth": "b"}}, "input.depth"),
        ({"input": {"disparity": "a", "depth": "b", "constant_disparity": 1}}, "input.depth"),
        ({"input": {"depth_convention": "midas"}}, "input.depth_convention"),
        ({"input": {"channel": "Z"}}, "input.channel"),
        ({"depth": {"invert": True}}, "depth.invert"),
        ({"depth": {"value_range": (0, 1)}}, "depth.value_range"),
        ({"depth": {"as_stored": True}, "input": {"depth": "a"}}, "depth.as_stored"),
        ({"depth": {"unit": "m"}, "input": {"disparity": "a"}}, "depth.unit"),
        ({"focus": {"value": 0.5, "distance": 2}}, "focus.distance"),
        ({"focus": {"at": (1, 2), "range": (1, 2)}}, "focus.range"),
        ({"focus": {"plane": ((1, 1), (5, 1), (1, 5)), "tilt_y": 1}}, "focus.plane"),
        ({"aperture": {"curvature": 0}}, "aperture.curvature"),
        ({"aperture": {"rotation": 0}}, "aperture.rotation"),
        ({"aperture": {"onion_rings": 5}}, "aperture.onion_rings"),
        ({"aperture": {"grain_seed": 0}}, "aperture.grain_seed"),
        ({"lens": {"aberrations": "traced"}}, "lens.aberrations"),
        ({"lens": {"engine": "profile"}}, "lens.engine"),
        ({"lens": {"name": "petzval", "engine": "profile", "distortion": True}}, "lens.distortion"),
        ({"lens": {"f_number": 2}}, "lens.f_number"),
        ({"lens": {"copy_to_copy": 1}}, "lens.copy_to_copy"),
        ({"lens": {"name": "petzval", "copy_seed": 1}}, "lens.copy_seed"),
        ({"lens": {"focusing": "paraxial"}}, "lens.focusing"),
        ({"lens": {"distortion": True}}, "lens.distortion"),
        ({"color": {"axial_map": "linear", "lateral": 1}}, "color.axial_map"),
        ({"color": {"lateral_map": "linear", "axial": 1}}, "color.lateral_map"),
        ({"color": {"glass": "F2"}}, "color.glass"),
        ({"color": {"dispersion": "rgb"}}, "color.dispersion"),
        ({"color": {"equaliser": (1, 2)}}, "color.equaliser"),
        ({"color": {"equaliser": "gains.txt"}, "lens": {"coma": 2}}, "color.equaliser"),
        ({"highlights": {"gain": 8}}, "highlights.gain"),
        ({"highlights": {"gain": 8, "threshold": "off"}}, "highlights.gain"),
        ({"highlights": {"strength": 2, "threshold": 0.9}}, "highlights.strength"),
        ({"effects": {"vignette_radius": 0.3}}, "effects.vignette_radius"),
        ({"effects": {"vignette_softness": 0.3}}, "effects.vignette_softness"),
        ({"effects": {"vignette_roundness": 0.3}}, "effects.vignette_roundness"),
        ({"effects": {"vignette_color_loss": 0.3}}, "effects.vignette_color_loss"),
        ({"effects": {"grain_size": 1}}, "effects.grain_size"),
        ({"effects": {"grain_mono": True}}, "effects.grain_mono"),
        ({"effects": {"grain_seed": 0}}, "effects.grain_seed"),
        ({"effects": {"brown": (0,), "distortion": 0.1}}, "effects.brown"),
        ({"engine": {"name": "scatter"}, "lens": {"name": "petzval"}}, "lens.name"),
        ({"engine": {"name": "scatter"}, "lens": {"coma": 1}}, "lens.coma"),
        ({"engine": {"name": "fast"}, "color": {"lateral": 1}}, "color.lateral"),
    ],
)
def test_what_does_not_go_together_is_refused_by_its_field(changes, parameter):
    with pytest.raises(ParameterError) as caught:
        RenderSettings().updated(changes)
    assert caught.value.parameter == parameter
    assert caught.value.expected


def test_a_strength_of_0_keeps_what_goes_with_it():
    """The command line accepts an effect that is switched off together with its numbers."""
    RenderSettings().updated(
        {"effects": {"vignette": 0, "vignette_radius": 0.5, "grain": 0, "grain_mono": True}}
    )
    RenderSettings().updated({"color": {"dispersion": "continuous", "equaliser": (1,)}})


def test_more_than_two_ways_are_all_named():
    with pytest.raises(ParameterError) as caught:
        FocusSettings(value=0.5, at=(1, 1), range=(0, 1))
    assert "`focus.value` and `focus.at` and `focus.range`, got all; keep one" in str(caught.value)


@pytest.mark.parametrize(
    ("depth", "name"),
    [
        ({"near": 1.0}, "depth.far"),
        ({"far": 1.0}, "depth.near"),
        ({"kind": "zbuffer"}, "depth.kind"),
        ({"near": 1.0, "far": 2.0, "unit": "mm"}, "depth.unit"),
        ({"near": 1.0, "far": 2.0, "kind": "ray"}, "depth.kind"),
        ({"near": 1.0, "far": 1.0}, "depth.far"),
        ({"near": 1.0, "far": math.inf}, "depth.far"),
    ],
)
def test_planes_of_stored_depth_must_be_consistent(depth, name):
    with pytest.raises(ParameterError, match=f"^{name}: expected"):
        RenderSettings().updated({"input": {"depth": "z.png"}, "depth": depth})


@pytest.mark.parametrize("name", ["coding", "no_data", "holes"])
def test_options_of_stored_maps_need_a_map(name):
    value = {"coding": "turbo", "no_data": 0, "holes": "fill"}[name]
    with pytest.raises(ParameterError, match=f"depth.{name}: expected `input.disparity` or `input.depth`"):
        RenderSettings().updated({"input": {"constant_disparity": 0}, "depth": {name: value}})


def test_every_field_has_help_and_a_flag_of_its_own():
    flags = [flag for known in all_settings().values() for flag in (known.flag, *known.aliases) if flag]
    assert len(flags) == len(set(flags)) == len(settings_by_flag())
    for path, known in all_settings().items():
        assert known.help
        assert known.help.endswith(".")
        assert (known.flag is None) == (path == "depth.as_stored")
        assert known.default is None or known.checked(known.default) == known.default
    assert typing.get_type_hints(RenderSettings).keys() == {group.GROUP for group in group_types()}


def test_tables_say_which_file_is_wrong():
    with pytest.raises(ConfigError, match=r"^my.toml: unknown option"):
        settings_from_table({"blads": 5}, "my.toml")
    assert settings_from_table({"rim": 1, "lens": {"coma": 2}}) == {
        "aperture": {"spherical_profile": 1},
        "lens": {"coma": 2},
    }
    assert RenderSettings().updated(settings_from_table({"lens": "petzval"})).lens == LensSettings(
        name="petzval"
    )

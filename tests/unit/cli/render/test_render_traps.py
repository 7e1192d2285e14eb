"""Inputs that could give a wrong picture silently: each is right, is reported in a line, or is refused."""

import numpy as np
import pytest

from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.io.image import read_image, write_image
from bokehnet.io.maps import read_map
from tests.unit.io.exr.exr_files import deep_samples, write_deep, write_exr

RELATIVE = ["--blur", "6", "--focus", "0.4", "--engine", "scatter", "--repair-disparity", "off"]
CAMERA = ["--focal-length", "50", "--f-number", "2", "--sensor-width", "36"]
METRIC = [*CAMERA, "--focus-distance", "2", "--engine", "scatter", "--repair-disparity", "off"]


def notes(outcome):
    assert (outcome.code, outcome.out) == (0, "")
    *result, summary = outcome.err.splitlines()
    assert "note" not in summary
    return [line.removeprefix("bokehnet: note: ") for line in result]


def pull_apart(picture):
    return {name: ("half", np.asarray(picture)[..., i]) for i, name in enumerate("RGB")}


@pytest.mark.parametrize("resize", [[], ["--resize-disparity"]])
@pytest.mark.parametrize("size", [(64, 40), (32, 20), (31, 20)])
def test_a_map_that_is_turned_against_its_picture_is_not_squashed(folder, fails, resize, size):
    write_image("turned.png", np.random.default_rng(0).random((*size, 1)).repeat(3, -1))
    words = ["render", "photo.png", "--disparity", "turned.png", *RELATIVE, *resize]
    fails(
        words,
        f"64x40 pixels but its disparity is {size[1]}x{size[0]}, turned by 90 degrees",
        "rotate the map",
    )


def test_a_square_map_is_stretched_on_request(folder, cli):
    """Networks may see a square: the side of either is no sign of a turn."""
    write_image("square.png", np.linspace(0, 1, 32 * 32).reshape(32, 32, 1).repeat(3, -1))
    words = ["--disparity", "square.png", *RELATIVE, "--resize-disparity", "-o", "out.png"]
    assert notes(cli("render", "photo.png", *words)) == []


@pytest.mark.parametrize("output", ["disparity.png", "./disparity.png"])
def test_the_map_is_not_written_over(folder, cli, output):
    before = (folder / "disparity.png").read_bytes()
    outcome = cli("render", "photo.png", "--disparity", "disparity.png", *RELATIVE, "-o", output)
    assert outcome.code == 1
    assert "--output: expected another name: disparity.png is read for this picture" in outcome.err
    assert (folder / "disparity.png").read_bytes() == before


def test_a_photo_is_not_compressed_twice(folder, cli):
    write_image("photo.jpg", read_image("photo.png"))
    before = (folder / "photo.jpg").read_bytes()
    outcome = cli("render", "photo.jpg", "--disparity", "disparity.png", *RELATIVE, "-o", "photo.jpg")
    assert outcome.code == 1
    assert (
        "is the picture itself, which would be compressed with loss once more; write to a new" in outcome.err
    )
    assert (folder / "photo.jpg").read_bytes() == before


def test_deep_samples_and_wide_channels_are_not_written_over(folder, cli):
    write_deep(folder / "deep.exr", deep_samples())
    write_image("wide.png", read_image("photo.png"), bits=16)
    for name, why in (("deep.exr", "deep samples"), ("wide.png", "more than 8 bits")):
        outcome = cli("render", name, "--constant-disparity", "0.5", *RELATIVE, "-o", name)
        assert outcome.code == 1
        assert f"is the picture itself, which holds {why}" in outcome.err


def test_a_png_and_an_exr_may_be_written_in_place(folder, cli):
    assert (
        notes(cli("render", "photo.png", "--disparity", "disparity.png", *RELATIVE, "-o", "photo.png")) == []
    )
    outcome = cli("render", "camera.exr", "--depth", "camera.exr", *METRIC, "-o", "camera.exr")
    assert notes(outcome) == []
    assert np.isinf(read_map("camera.exr", "Z")).any()  # its other channels stay


def test_a_constant_map_is_reported(folder, cli):
    write_image("flat.png", np.full((40, 64, 3), srgb_to_linear(np.float32(188 / 255))))
    result = notes(cli("render", "photo.png", "--disparity", "flat.png", *RELATIVE, "-o", "out.png"))
    assert result == [
        "the disparity map is 0.737255 everywhere: all is equally sharp",
        *result[1:],
    ]
    assert "nothing is sharp: focus is at 0.4, disparity 0.737" in result[1]


def test_a_map_whose_range_single_pixels_set_is_reported(folder, cli):
    values = np.full((40, 64, 3), srgb_to_linear(np.float32(200 / 255)))
    values[0, 0] = srgb_to_linear(np.float32(20 / 255))
    write_image("hot.png", values)
    result, *_ = notes(cli("render", "photo.png", "--disparity", "hot.png", *RELATIVE, "-o", "out.png"))
    assert result.startswith("single pixels set the range of the disparity map, 0.0784314 to 0.784314")
    assert "--disparity-range sets" in result


def test_codes_of_an_integer_map_are_no_range_of_its_values(folder, fails):
    words = ["render", "photo.png", "--disparity", "disparity.png", *RELATIVE, "--disparity-range", "0,255"]
    fails(words, "--disparity-range: expected values of 0 to 1: codes of this map count over 255, got")


def test_a_map_that_is_nearly_constant_is_reported(folder, cli, write_channels):
    values = np.full((40, 64), 0.5)
    values[:, 30:] = 0.5005
    write_channels(folder / "flat.exr", disparity=values)
    result, *_ = notes(cli("render", "photo.png", "--disparity", "flat.exr", *RELATIVE, "-o", "out.png"))
    assert result.startswith("the disparity map only ranges from 0.5 to 0.5005")
    assert "--disparity-range sets" in result
    words = [*RELATIVE, "--disparity-range", "0,1", "-o", "out.png"]
    assert notes(cli("render", "photo.png", "--disparity", "flat.exr", *words)) == []


@pytest.mark.parametrize(
    ("factor", "unit", "words"),
    [
        (100, "m", "nothing is sharp: focus is at 2 m, depth 150 to 500 m"),  # centimetres
        (100, "cm", None),
        (0.001, "m", "nothing is sharp: focus is at 2 m, depth 0.0015 to 0.005 m"),
        (0.001, "1/m", "nothing is sharp: focus is at 2 m, depth 200 to 666.7 m"),
    ],
)
def test_depth_in_another_unit_is_reported(folder, cli, write_channels, factor, unit, words):
    write_image("large.png", np.random.default_rng(0).random((200, 300, 3)))
    metres = np.tile(np.linspace(1.5, 5, 300), (200, 1))
    write_channels(folder / "z.exr", Z=metres * factor)
    options = [*METRIC, "--depth-unit", unit, "-o", "out.png"]
    results = [
        line
        for line in notes(cli("render", "large.png", "--depth", "z.exr", *options))
        if line and "%" not in line
    ]
    expected = [] if words is None else [line for line in results if words in line]
    assert results == expected
    assert all("check --depth-unit" in line for line in results)
    assert bool(results) == (words is not None)


def test_a_camera_without_blur_is_reported(folder, cli, write_channels):
    write_channels(folder / "z.exr", Z=np.tile(np.linspace(900, 5000, 64), (40, 1)))
    words = [*CAMERA, "--focus-distance", "2000", "--engine", "scatter", "-o", "out.png"]
    (result,) = notes(cli("render", "photo.png", "--depth", "z.exr", *words))
    assert result.startswith("everything is sharp: focus is at 2000 m, depth 900 to 5000 m, ")


def test_the_depth_of_an_exr_is_its_own(folder, cli):
    requested = notes(cli("render", "camera.exr", "--depth", "camera.exr", *METRIC, "-o", "asked.exr"))
    (result,) = notes(cli("render", "camera.exr", *METRIC, "-o", "own.exr"))
    assert (requested, result) == (
        [],
        "camera.exr: using its channel Z as depth in metres; --depth overrides this",
    )
    assert (folder / "asked.exr").read_bytes() == (folder / "own.exr").read_bytes()


def test_the_depth_of_an_exr_may_be_blurred_as_disparity(folder, cli):
    outcome = cli("render", "camera.exr", *RELATIVE, "-o", "own.exr")
    (result,) = notes(outcome)
    assert result.startswith("camera.exr: using its channel Z as depth in metres")
    assert "disparity relative to its range (--depth keeps metres)" in outcome.err


@pytest.mark.parametrize("name", ["ViewLayer.Depth.Z", "ViewLayer.Depth.V", "Depth.V", "ViewLayer.depth"])
def test_every_name_of_blender_s_depth_is_found(folder, cli, name):
    picture = np.random.default_rng(0).random((40, 64, 3))
    colours = {f"ViewLayer.Combined.{c}": ("half", picture[..., i]) for i, c in enumerate("RGB")}
    depth = np.tile(np.linspace(1, 5, 64), (40, 1))
    write_exr(folder / "a.exr", {"channels": {**colours, name: ("float", depth)}})
    (result,) = notes(cli("render", "a.exr", *METRIC, "-o", "out.exr"))
    assert result == f"a.exr: using its channel {name} as depth in metres; --depth overrides this"
    assert notes(cli("render", "a.exr", "--depth", "a.exr", *METRIC, "-o", "out.exr")) == []


def test_of_several_view_layers_the_choice_is_named_and_depth_is_of_the_same(folder, cli):
    channels = {}
    for layer, value in (("Near", 0.25), ("Far", 0.5)):
        channels |= {f"{layer}.Combined.{c}": ("half", np.full((8, 12), value)) for c in "RGB"}
        channels[f"{layer}.Depth.Z"] = ("float", np.linspace(1, 4, 96).reshape(8, 12) + 8 * value)
    write_exr(folder / "a.exr", {"channels": channels})
    words = [*CAMERA, "--focus-distance", "6", "--engine", "scatter", "-o", "out.png"]
    result = notes(cli("render", "a.exr", *words))
    selected = "Far" if np.allclose(read_image("out.png"), 0.5, atol=0.01) else "Near"
    assert (
        result[0] == f"a.exr: of the layers Far.Combined, Near.Combined only {selected}.Combined is rendered"
    )
    assert (
        result[1] == f"a.exr: using its channel {selected}.Depth.Z as depth in metres; --depth overrides this"
    )


def test_of_a_stereo_pair_the_view_that_is_rendered_is_named(folder, cli):
    picture = np.random.default_rng(0).random((40, 64, 3))
    parts = [
        {"channels": pull_apart(picture), "attributes": {"oiio:subimagename": f"rgb.{view}", "view": view}}
        for view in ("left", "right")
    ]
    write_exr(folder / "a.exr", *parts)
    words = ["--disparity", "disparity.png", *RELATIVE, "-o", "out.png"]
    assert notes(cli("render", "a.exr", *words)) == ["a.exr: of the views left, right only left is rendered"]


def test_of_two_views_in_one_part_the_default_one_is_rendered(folder, cli):
    picture = np.random.default_rng(0).random((40, 64, 3))
    channels = {**pull_apart(picture), **{f"right.{n}": c for n, c in pull_apart(picture / 2).items()}}
    views = ("string[2]", ("left", "right"))
    write_exr(folder / "a.exr", {"channels": channels, "attributes": {"multiView": views}})
    words = ["--disparity", "disparity.png", *RELATIVE, "-o", "out.png"]
    assert notes(cli("render", "a.exr", *words)) == ["a.exr: of the views left, right only left is rendered"]


@pytest.mark.parametrize("hole", [np.nan, 0, -1])
def test_holes_of_metric_depth_are_counted_and_placed(folder, fails, write_channels, hole):
    depth = np.full((40, 64), 3.0)
    depth[5, 7:9] = hole
    write_channels(folder / "holes.exr", Z=depth)
    words = ["render", "photo.png", "--depth", "holes.exr", *METRIC, "--holes", "error"]
    fails(words, "2 pixels", "first at x=7, y=5", "holes")


@pytest.mark.parametrize("hole", [np.nan, np.inf])
def test_holes_of_disparity_are_counted_and_placed(folder, fails, write_channels, hole):
    values = np.full((40, 64), 0.5)
    values[5, 7:9] = hole
    write_channels(folder / "holes.exr", disparity=values)
    words = ["render", "photo.png", "--disparity", "holes.exr", *RELATIVE, "--holes", "error"]
    fails(words, "2 pixels", "first at x=7, y=5", "--holes fill fills them")


def test_no_data_of_disparity_is_infinitely_far(folder, cli, write_channels):
    """0 is what a disparity map says of the sky, so it is no hole."""
    values = np.full((40, 64), 1.0)
    values[:, :20] = 0
    write_channels(folder / "d.exr", disparity=values)
    assert notes(cli("render", "photo.png", "--disparity", "d.exr", *RELATIVE, "-o", "out.png")) == []


@pytest.mark.parametrize("jobs", [[], ["--jobs", "2"]])
def test_the_first_frame_of_a_sequence_decides(folder, cli_process, jobs):
    write_image("flat.png", np.full((40, 64, 3), 0.5))
    for frame in (1, 2, 3):
        write_image(f"shot.{frame}.png", read_image("photo.png"))
    words = ["--disparity", "flat.png", *RELATIVE, "--disparity-range", "0,1", "--frames", "1-3", *jobs]
    paths = {"shot.#.png": folder / "shot.#.png", "flat.png": folder / "flat.png"}
    outcome = cli_process(
        "render", folder / "shot.#.png", *[paths.get(w, w) for w in words], "-o", folder / "out.#.png"
    )
    assert outcome.code == 0
    assert outcome.err.count("bokehnet: note: nothing is sharp") == 1

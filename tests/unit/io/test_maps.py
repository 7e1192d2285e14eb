import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.depth.false_colors import TABLES_FILE
from bokehnet.io.frame import read_frame
from bokehnet.io.maps import (
    read_depth,
    read_disparity,
    read_map,
    read_map_header,
    read_stored_map,
    resize_map,
)
from bokehnet.io.selection.map_channels import depth_channels
from tests.unit.io.exr.exr_files import write_exr


@pytest.mark.parametrize(("dtype", "top"), [(np.uint8, 255), (np.uint16, 65535)])
def test_integer_maps_are_scaled_without_a_curve(store, dtype, top):
    stored = np.array([[0, 1, top // 2, top]], dtype)
    assert_allclose(read_map(store("a.png", stored)), stored / top, rtol=1e-7)


def test_a_colour_picture_counts_only_when_grey(store):
    grey = np.repeat(np.arange(6, dtype=np.uint8).reshape(2, 3, 1), 3, axis=2)
    assert_allclose(read_map(store("a.png", grey)), grey[..., 0] / 255)
    grey[0, 0, 2] += 90
    with pytest.raises(ImageFileError, match=r"colour picture.*depth.coding"):
        read_map(store("b.png", grey))


def test_a_tint_of_a_few_levels_is_read_with_a_note(store):
    """Authority: the grey values before the tint; colour management and screenshots leave such tints."""
    grey = np.repeat(np.arange(0, 240, 40, dtype=np.uint8).reshape(2, 3, 1), 3, axis=2)
    tinted = grey + np.array([0, 2, 0], np.uint8)
    stored = read_stored_map(store("a.png", tinted))
    assert_allclose(stored.values, grey[..., 0] / 255, atol=1 / 255)
    assert "differ by up to 2 of 255 levels" in stored.notes[0]
    assert stored.assumptions == ("tinted grey",)


def test_alpha_of_a_map_is_ignored(store):
    stored = np.array([[[100, 128], [200, 0]]], np.uint8)
    assert_allclose(read_map(store("a.tif", stored, ["Y", "A"])) * 255, [[100, 200]], rtol=1e-6)


def test_orientation_of_a_map_is_applied(store):
    stored = np.array([[0, 50, 100]], np.uint8)
    assert_allclose(read_map(store("a.png", stored, Orientation=6)) * 255, [[0], [50], [100]], atol=1e-4)


@pytest.mark.parametrize(
    ("channels", "best"),
    [
        (["R", "G", "B", "Z"], "Z"),
        (["R", "G", "B", "depth.Z"], "depth.Z"),
        (["Y", "depth"], "depth"),
        (["disparity", "Y"], "disparity"),
        (["odd"], "odd"),
        (["View.Mist.Z", "View.Depth.Z"], "View.Depth.Z"),
        (["V.Normal.X", "V.Normal.Y", "V.Normal.Z", "V.Depth.Z"], "V.Depth.Z"),
        (["R", "G", "B", "A", "View.Z"], "View.Z"),
    ],
)
def test_the_default_channel_follows_the_order_of_names(store, channels, best):
    stored = np.broadcast_to(np.arange(len(channels), dtype=np.float32), (2, 2, len(channels)))
    assert read_map(store("a.exr", stored, channels))[0, 0] == channels.index(best)


@pytest.mark.parametrize("channels", [["Left.Z", "Right.Z"], ["N.X", "N.Y", "N.Z"], ["P", "Q"]])
def test_an_unclear_channel_is_requested_by_name(store, channels):
    stored = np.broadcast_to(np.arange(len(channels), dtype=np.float32), (2, 2, len(channels)))
    path = store("a.exr", stored, channels)
    with pytest.raises(ImageFileError, match=", ".join(channels)):
        read_map(path)
    assert read_map(path, channels[1])[0, 0] == 1
    with pytest.raises(ImageFileError, match="no channel 'nope'.*" + channels[0]):
        read_map(path, "nope")


def test_a_channel_is_found_in_a_later_part(store_parts):
    path = store_parts("a.exr", [(["R", "G", "B"], np.zeros((2, 2, 3))), (["Z"], np.full((2, 2, 1), 7.0))])
    assert (read_map(path) == 7).all()


def test_depth_channels_lists_the_best_first():
    assert depth_channels(["Y", "R", "View.Z", "Z", "N.X", "N.Z"]) == ["Z", "Y", "View.Z"]


def test_disparity_is_normalised_by_its_own_range(store):
    stored = np.array([[-3.0, 1.0, 5.0]], np.float32)
    assert_array_equal(read_disparity(store("a.exr", stored, ["disparity"])), [[0, 0.5, 1]])
    wide = np.array([[-3e38, 0.0, 3e38]], np.float32)
    assert_array_equal(read_disparity(store("b.exr", wide, ["disparity"])), [[0, 0.5, 1]])


@pytest.mark.parametrize(("value", "expected"), [(0.25, 0.25), (7.0, 1.0), (-2.0, 0.0)])
def test_a_constant_disparity_keeps_its_value(store, value, expected):
    path = store("a.exr", np.full((2, 2), value, np.float32), ["Y"])
    assert (read_disparity(path) == expected).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_disparity_that_is_not_finite_is_an_error_with_its_place(store, bad):
    stored = np.ones((3, 4), np.float32)
    stored[1, 2] = stored[2, 0] = bad
    with pytest.raises(ImageFileError, match=r"at 2 pixels, first at x=2, y=1"):
        read_disparity(store("a.exr", stored, ["Y"]))


def test_depth_becomes_millimetres_and_sky_stays_far(store):
    stored = np.array([[0.5, 2.0, 1e10, np.inf, 3e38]], np.float32)
    depth = read_depth(store("a.exr", stored, ["Z"]))
    assert depth.dtype == np.float32
    assert_allclose(depth, [[500, 2000, 1e13, np.inf, np.inf]], rtol=1e-6)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, -np.inf])
def test_depth_that_is_not_positive_is_an_error_with_count_place_and_way_out(store, bad):
    stored = np.ones((3, 4), np.float32)
    stored[2, 1] = bad
    with pytest.raises(ImageFileError, match=r"at 1 pixels, first at x=1, y=2 .*; set sky to infinity"):
        read_depth(store("a.exr", stored, ["Z"]))


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1), ("cm", 10), ("m", 1000), ("in", 25.4), ("ft", 304.8)])
def test_depth_comes_in_many_units(store, unit, mm):
    """Exact: the international inch is 25.4 mm."""
    depth = read_depth(store("a.exr", np.array([[0.5, 2.0, np.inf]], np.float32), ["Z"]), unit=unit)
    assert_allclose(depth, [[0.5 * mm, 2 * mm, np.inf]], rtol=1e-6)


def test_metric_disparity_is_the_inverse_of_depth_and_sky_is_zero(store):
    path = store("a.exr", np.array([[0.5, 2.0, 0.0, -0.0, 1e-38]], np.float32), ["Z"])
    depth = read_depth(path, unit="1/m")
    assert depth.dtype == np.float32
    assert_allclose(depth, [[2000, 500, np.inf, np.inf, np.inf]], rtol=1e-6)


@pytest.mark.parametrize("bad", [-0.5, np.nan, np.inf])
def test_metric_disparity_that_is_no_disparity_is_an_error(store, bad):
    path = store("a.exr", np.array([[0.5, bad]], np.float32), ["Z"])
    with pytest.raises(ImageFileError, match=r"at 1 pixels, first at x=1, y=0 .*; set sky to 0"):
        read_depth(path, unit="1/m")


def test_an_unknown_unit_is_an_error_that_lists_the_known_ones(store):
    path = store("a.exr", np.ones((2, 2), np.float32), ["Z"])
    with pytest.raises(ParameterError, match=r"unit: expected one of mm, cm, m, in, ft, 1/m, .*got 'km'"):
        read_depth(path, unit="km")


def test_normalised_depth_is_turned_round(store):
    stored = np.array([[0.2, 0.5, 1.0]], np.float32)
    path = store("a.exr", stored, ["Z"])
    assert_allclose(read_disparity(path, invert=True), [[1, 0.625, 0]], atol=1e-7)
    assert_allclose(read_disparity(path, invert=True, normalise=False), 1 - stored, atol=1e-7)
    assert_array_equal(read_disparity(path, normalise=False), stored)
    levels = np.array([[0, 51, 255]], np.uint8)
    path = store("b.png", levels)
    assert_allclose(read_disparity(path, invert=True), 1 - levels / 255, atol=1e-6)
    assert (
        read_disparity(store("c.exr", np.full((2, 2), 0.3, np.float32), ["Z"]), invert=True)
        == 1 - np.float32(0.3)
    ).all()


def test_infinity_in_normalised_depth_names_the_other_convention(store):
    path = store("a.exr", np.array([[0.2, np.inf]], np.float32), ["Z"])
    with pytest.raises(ImageFileError, match="is read as depth"):
        read_disparity(path, invert=True)


def test_values_as_stored_may_leave_zero_to_one(store):
    stored = np.array([[-3.0, 1.0, 5.0]], np.float32)
    assert_array_equal(read_disparity(store("a.exr", stored, ["disparity"]), normalise=False), stored)


def test_a_channel_of_several_parts_is_named_with_its_part(store_parts):
    left, right = np.full((2, 2, 1), 1.0), np.full((2, 2, 1), 2.0)
    path = store_parts("a.exr", [(["Z"], left), (["Z"], right)])
    assert (read_map(path, "part1.Z") == 2).all()
    assert (read_map(path, "part0.Z") == 1).all()
    with pytest.raises(ImageFileError, match=r"2 channels are called 'Z'; name one of part0\.Z, part1\.Z"):
        read_map(path, "Z")
    with pytest.raises(ImageFileError, match=r"which channel.*part0\.Z, part1\.Z"):
        read_map(path)


def test_a_channel_of_a_layer_is_found_by_its_last_name(store_parts):
    """As Blender writes them; the Z of a normal is no depth."""
    values = np.stack([np.full((2, 2), number, np.float64) for number in range(5)], -1)
    names = ["ViewLayer.Depth.Z", *(f"ViewLayer.Normal.{axis}" for axis in "XYZ"), "Back.Mist.A"]
    path = store_parts("a.exr", [(names, values)])
    assert (read_map(path, "Z") == 0).all()
    path = store_parts("b.exr", [(["Front.Depth.Z", "Back.Depth.Z"], values[..., :2])])
    with pytest.raises(ImageFileError, match="2 channels are called 'Z'; name one of"):
        read_map(path, "Z")


def test_a_map_with_another_data_window_is_brought_onto_the_pictures(tmp_path):
    """Formula: pixel (x, y) of the display window is the same place in both files."""
    y, x = np.mgrid[:8, :10]
    display = {"full_x": 0, "full_y": 0, "full_width": 10, "full_height": 8}
    colours = {c: ("float", np.zeros((8, 10))) for c in "RGB"}
    shifted = {"Z": ("float", (x + 100 * y)[1:7, 2:9])}
    frame = read_frame(write_exr(tmp_path / "a.exr", {"channels": colours, **display}))
    path = write_exr(tmp_path / "z.exr", {"channels": shifted, "x": 2, "y": 1, **display})
    moved = read_map(path, window=frame.window)
    assert_array_equal(moved, np.clip(x, 2, 8) + 100 * np.clip(y, 1, 6))
    assert read_map(path).shape == (6, 7)
    other = write_exr(
        tmp_path / "b.exr", {"channels": shifted}
    )  # another display window: only resizing helps
    assert read_map(other, window=frame.window).shape == (6, 7)


def test_integer_depth_is_refused_because_its_unit_is_unknown(store):
    with pytest.raises(ImageFileError, match=r"integers up to 65535.*EXR"):
        read_depth(store("a.png", np.ones((2, 2), np.uint16)))


def test_resizing_to_the_same_size_changes_nothing():
    values = np.random.default_rng(0).random((5, 7), dtype=np.float32)
    assert_array_equal(resize_map(values, 5, 7), values)


def test_resizing_a_slope_is_linear_at_pixel_centres():
    """Formula: a plane sampled at pixel centres, away from the border where it is extended."""
    column = (np.arange(64, dtype=np.float32) + 0.5) / 64
    values = np.broadcast_to(column, (64, 64))
    expected = (np.arange(192) + 0.5) / 192
    result = resize_map(values, 192, 192)
    assert_allclose(result[:, 3:-3], np.broadcast_to(expected[3:-3], (192, 186)), atol=1e-6)


def test_resizing_makes_up_no_depth_between_near_and_far():
    values = np.zeros((6, 6), np.float32)
    values[:, 3:] = 1
    result = resize_map(values, 40, 50)
    assert set(np.unique(result)) == {0.0, 1.0}
    assert (result[:, :25] == 0).all()
    assert (result[:, 25:] == 1).all()


@pytest.mark.parametrize(("height", "width"), [(1, 1), (3, 11), (40, 2)])
def test_resizing_stays_within_the_range_and_has_the_requested_size(height, width):
    values = np.random.default_rng(0).random((7, 5), dtype=np.float32)
    result = resize_map(values, height, width)
    assert result.shape == (height, width)
    assert values.min() <= result.min() <= result.max() <= values.max()


def test_real_maps_are_read(shared):
    disparity = read_disparity(shared("real/21.png"))
    assert disparity.shape == (1350, 1080)
    assert (disparity.min(), disparity.max()) == (0, 1)
    assert 400 < read_depth(shared("cycles/s1_still_life/depth.exr")).min() < 500


@pytest.mark.parametrize("size", [(41, 67), (120, 201), (123, 200), (13, 7), (1, 1)])
def test_a_slope_stays_a_slope_at_any_factor(size):
    """Authority: pixel centres at (i + 1/2) of N; between the outermost ones a slope is linear."""
    values = np.add.outer(np.arange(40) / 40, np.arange(67) / 67).astype(np.float32)
    resized = resize_map(values, *size)
    rows = np.clip((np.arange(size[0]) + 0.5) / size[0] * 40 - 0.5, 0, 39) / 40
    columns = np.clip((np.arange(size[1]) + 0.5) / size[1] * 67 - 0.5, 0, 66) / 67
    assert_allclose(resized, np.add.outer(rows, columns), atol=1e-5)


@pytest.mark.parametrize("factor", [3, 5, 7])
def test_a_step_stays_a_step_in_its_place_at_odd_factors(factor):
    values = np.zeros((5, 8), np.float32)
    values[:, 3:] = 1
    resized = resize_map(values, 5 * factor, 8 * factor)
    assert_array_equal(resized, np.repeat(np.repeat(values, factor, 0), factor, 1))


@pytest.mark.parametrize(("hidden", "noted"), [(0, False), (12, True), (96, False)])
def test_transparent_pixels_of_a_map_keep_their_values_with_a_note(tmp_path, hidden, noted):
    image = pytest.importorskip("PIL.Image")
    grey = np.arange(96, dtype=np.uint8).reshape(8, 12)
    alpha = np.full(96, 255, np.uint8)
    alpha[:hidden] = 0
    image.fromarray(np.dstack([grey, alpha.reshape(8, 12)])).save(tmp_path / "map.png")
    stored = read_stored_map(tmp_path / "map.png")
    np.testing.assert_array_equal(stored.numbers, grey)
    assert any(f"{hidden} pixels of the map are transparent" in note for note in stored.notes) == noted


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.npy", "a.npz"])
def test_the_header_of_a_map_agrees_with_the_map(store, tmp_path, name):
    values = np.arange(6, dtype=np.uint16).reshape(2, 3)
    path = tmp_path / name
    if path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".npz":
        np.savez(path, depth=values)
    else:
        path = store(name, values)
    header, stored = read_map_header(path), read_stored_map(path)
    assert (header.window.height, header.window.width) == stored.values.shape
    assert header.largest_integer == stored.largest_integer == 65535


def test_the_header_of_a_turned_map_is_upright(store):
    window = read_map_header(store("a.png", np.array([[0, 50, 100]], np.uint8), Orientation=6)).window
    assert (window.width, window.height) == (1, 3)


def test_the_header_of_colours_refuses_what_the_map_refuses(store):
    """Grey and colours of a table pass; a photograph is refused."""
    tables = np.load(TABLES_FILE)[0][None, :, :].repeat(24, axis=0)
    photograph = np.random.default_rng(0).integers(0, 255, (24, 256, 3), np.uint8)
    for name, colors in (("grey.png", tables[..., :1].repeat(3, axis=2)), ("turbo.png", tables)):
        assert read_map_header(store(name, colors.astype(np.uint8))).largest_integer is None
    with pytest.raises(ImageFileError, match=r"colour picture.*depth.coding"):
        read_map_header(store("photograph.png", photograph))

"""Supersampled scenes, mattes and deep samples, from files and arrays to the picture.

Authority: a slanted edge between two planes of one colour each, whose blur is known in closed form.
"""

from json import loads
from pathlib import Path

import numpy as np
import pytest

from bokehnet import (
    BokehRenderer,
    CameraSettings,
    DefocusMap,
    DepthSettings,
    FocusSettings,
    InputSettings,
    MetricDepth,
    RelativeDisparity,
    RenderSettings,
    make_scene,
    read_scene,
)
from bokehnet.errors import BokehnetError, ImageFileError, ParameterError, ShapeError
from bokehnet.io.image import read_image, write_image, write_map
from bokehnet.io.window import Window
from bokehnet.optics.pixels.pixel_filter import PixelFilter
from bokehnet.optics.pixels.supersampling import downsample
from bokehnet.scene.known_edges import matte_surfaces
from tests.unit.io.exr_files import write_deep, write_exr
from train.evaluation_sets import path_traced_shots
from train.metrics import compare

HEIGHT, WIDTH = 48, 64
FRONT, BACK = np.float32([0.9, 0.2, 0.1]), np.float32([0.1, 0.3, 0.8])


def share_of_front(factor):
    """Which samples of a picture at ``factor`` times the size show the front plane, (factor H, factor W)."""
    y, x = (np.mgrid[: factor * HEIGHT, : factor * WIDTH] + 0.5) / factor
    return x + 0.3 * y < 38.3


def planes(factor):
    front = share_of_front(factor)
    return np.where(front[..., None], FRONT, BACK), front


def filtered(factor=8):
    """The picture through the pixel filter, and the map at pixel centres: what a renderer gives."""
    return downsample(planes(factor)[0], factor), share_of_front(1)


def blurred(near, far, factor=8):
    """The truth: a disc of ``near`` pixels over the exact front, over a wall of one colour, filtered."""
    front = share_of_front(factor).astype(np.float64)
    reach = int(abs(near) * factor) + factor
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = (x * x + y * y <= max(abs(near) * factor, 0.5) ** 2).astype(np.float64)
    around = np.pad(front, reach, "edge")
    size = [n + len(disc) - 1 for n in around.shape]
    spread = np.fft.irfft2(np.fft.rfft2(around, size) * np.fft.rfft2(disc / disc.sum(), size), size)
    share = spread[2 * reach :, 2 * reach :][: front.shape[0], : front.shape[1]]
    coverage = downsample(share.astype(np.float32), factor)[..., None]
    return coverage * FRONT + (1 - coverage) * BACK


def inner_error(found, truth):
    """Root of the mean square away from the border, where pictures are taken to go on."""
    inside = np.s_[14:-14, 14:-14]
    return float(np.sqrt(np.mean((found[inside] - truth[inside]) ** 2)))


def rendered(scene, **groups):
    return BokehRenderer("rays").render(scene, RenderSettings(**groups)).bokeh


@pytest.mark.parametrize("factor", [2, 4])
@pytest.mark.parametrize(("near", "far"), [(0.0, -5.0), (5.0, 0.0)])
def test_a_supersampled_edge_is_nearer_to_the_truth(factor, near, far):
    image, front = planes(factor)
    fine = make_scene(image, DefocusMap(map=np.where(front, near, far)), supersampled=factor)
    small, centres = filtered()
    plain = make_scene(small, DefocusMap(map=np.where(centres, near, far)))
    truth = blurred(near, far)
    error = inner_error(rendered(fine), truth)
    assert error < 0.006
    assert error < inner_error(rendered(plain), truth) + 0.005 * (factor == 2 and near == 0) + 0.0005


def test_a_filter_that_is_told_makes_the_pixels_of_the_result():
    """In focus all is the fine picture through that filter."""
    rng = np.random.default_rng(0)
    image = rng.random((2 * HEIGHT, 2 * WIDTH, 3), dtype=np.float32)
    scene = make_scene(image, DefocusMap(map=np.zeros((2 * HEIGHT, 2 * WIDTH))), supersampled=2)
    told = DepthSettings(pixel_filter="gaussian:2.6")
    found = BokehRenderer("rays").render(scene, RenderSettings(depth=told)).bokeh
    np.testing.assert_allclose(found, downsample(image, 2, PixelFilter("gaussian", 2.6)), atol=2e-6)


def test_blur_and_focus_are_told_in_pixels_of_the_result():
    """A map, its focus and its blur mean the same at all sizes."""
    off = DepthSettings(repair="off")
    settings = RenderSettings(camera=CameraSettings(blur=10), focus=FocusSettings(at=(5, 5)), depth=off)
    for factor in (1, 2, 4):
        image, front = planes(factor)
        disparity = np.where(front, 0.75, 0.25).astype(np.float32)
        source = RelativeDisparity(map=disparity, as_stored=True)
        scene = make_scene(image, source, supersampled=factor)
        result = BokehRenderer("rays").render(scene, settings)
        assert result.bokeh.shape == (HEIGHT, WIDTH, 3)
        assert result.error_map.shape == result.defocus.shape == (HEIGHT, WIDTH)
        assert result.report.largest_blur == pytest.approx(5)
        assert result.report.focus_disparity == pytest.approx(0.75)
        np.testing.assert_allclose(result.defocus[24, [5, 60]], (0, -5), atol=1e-5)


def test_distances_and_alpha_come_down_too():
    image, front = planes(4)
    metres = np.where(front, 2.0, np.inf)
    camera = CameraSettings(focal_length=50, f_number=4, sensor_width=36)
    alpha = front.astype(np.float32)
    scene = make_scene(image * alpha[..., None], MetricDepth(map=metres), alpha=alpha, supersampled=4)
    settings = RenderSettings(camera=camera, focus=FocusSettings(distance=2))
    result = BokehRenderer("rays").render(scene, settings)
    assert result.alpha.shape == (HEIGHT, WIDTH)
    coverage = downsample(share_of_front(8).astype(np.float32), 8)
    assert inner_error(result.alpha, coverage) < 0.02
    # Premultiplied light over alpha is the colour of the front, as it was.
    shown = result.alpha > 0.05
    np.testing.assert_allclose((result.bokeh[shown] / result.alpha[shown][:, None]).mean(0), FRONT, atol=0.02)


def exact_coverage():
    return downsample(share_of_front(8).astype(np.float32), 8)


@pytest.mark.parametrize("shift", [0, -2])
def test_a_matte_puts_the_edge_where_it_is(shift):
    """The map's edge lies ``shift`` pixels off, the front too small; the matte is exact."""
    small, centres = filtered()
    matte = exact_coverage()
    source = DefocusMap(map=np.roll(np.where(centres, 6.0, 0.0), shift, 1))
    truth = blurred(6.0, 0.0)
    with_matte = inner_error(rendered(make_scene(small, source, matte=matte)), truth)
    without = inner_error(rendered(make_scene(small, source)), truth)
    assert with_matte < (0.01 if shift == 0 else 0.3 * without)


def test_a_matte_that_is_nowhere_all_front_is_of_no_edge():
    """Nothing tells what the front is then; seen as an error where the map was above 0."""
    soft = np.tile(np.linspace(0, 0.9, WIDTH, dtype=np.float32), (HEIGHT, 1))
    assert len(matte_surfaces(soft, np.full((HEIGHT, WIDTH), 0.5, np.float32)).rows) == 0


def test_a_matte_of_nothing_and_of_everything_changes_nothing():
    small, centres = filtered()
    source = DefocusMap(map=np.where(centres, 6.0, 0.0))
    plain = rendered(make_scene(small, source))
    for value in (0.0, 1.0):
        matte = np.full((HEIGHT, WIDTH), value, np.float32)
        np.testing.assert_array_equal(rendered(make_scene(small, source, matte=matte)), plain)


def test_a_matte_whose_front_is_farther_changes_nothing():
    small, centres = filtered()
    source = DefocusMap(map=np.where(centres, 6.0, 0.0))
    plain = rendered(make_scene(small, source))
    np.testing.assert_array_equal(rendered(make_scene(small, source, matte=1 - exact_coverage())), plain)


def deep_file(path):
    """Both planes, the edge's pixels with a sample of each: 2 m and 5 m."""
    coverage = exact_coverage()
    pixels = []
    for y in range(HEIGHT):
        row = []
        for x in range(WIDTH):
            samples = [{"R": BACK[0], "G": BACK[1], "B": BACK[2], "A": 1.0, "Z": 5.0, "ZBack": 5.0}]
            a = float(coverage[y, x])
            if a > 0.002:
                a = 1.0 if a > 0.998 else a
                samples.insert(
                    0,
                    {"R": a * FRONT[0], "G": a * FRONT[1], "B": a * FRONT[2], "A": a, "Z": 2.0, "ZBack": 2.0},
                )
            row.append(samples)
        pixels.append(row)
    return write_deep(path, pixels)


CAMERA = CameraSettings(focal_length=50, f_number=0.2, sensor_width=36)


def test_deep_samples_are_the_surfaces(tmp_path):
    path = deep_file(tmp_path / "deep.exr")
    settings = RenderSettings(input=InputSettings(depth=path), camera=CAMERA, focus=FocusSettings(distance=5))
    scene = read_scene(path, settings)
    coverage = exact_coverage()
    place = scene.known.rows, scene.known.columns
    np.testing.assert_allclose(scene.known.coverage, coverage[place], atol=2e-3)
    np.testing.assert_allclose(scene.known.near, 1 / 2000, rtol=1e-5)
    np.testing.assert_allclose(scene.known.far, 1 / 5000, rtol=1e-5)
    np.testing.assert_allclose(scene.known.front, np.tile(FRONT, (len(place[0]), 1)), atol=0.01)
    np.testing.assert_allclose(scene.known.back, np.tile(BACK, (len(place[0]), 1)), atol=0.01)
    result = BokehRenderer("rays").render(scene, settings)
    radius = result.report.largest_blur
    assert radius > 3
    assert inner_error(result.bokeh, blurred(radius, 0.0)) < 0.009
    assert result.report.repaired is None
    with pytest.raises(ParameterError, match=r"depth.repair: expected auto or off for a scene whose edges"):
        BokehRenderer("rays").render(scene, settings.updated({"depth": {"repair": "on"}}))


def test_where_deep_samples_leave_a_pixel_open_nothing_stands_behind(tmp_path):
    half = {"R": 0.4, "G": 0.2, "B": 0.1, "A": 0.5, "Z": 2.0, "ZBack": 2.0}
    path = write_deep(tmp_path / "open.exr", [[[half], []], [[half], [half]]])
    known = read_scene(path, source=MetricDepth(map=path)).known
    assert known.rows.tolist() == [0, 1, 1]
    assert (known.far == 0).all()
    assert (known.back == 0).all()
    np.testing.assert_allclose(known.front, np.tile([0.8, 0.4, 0.2], (3, 1)), atol=1e-3)
    assert read_scene(path, source=RelativeDisparity(map=np.ones((2, 2)))).known is None


def test_maps_of_the_surfaces_are_saved(tmp_path):
    small, centres = filtered()
    scene = make_scene(small, DefocusMap(map=np.where(centres, 6.0, 0.0)), matte=exact_coverage())
    result = BokehRenderer("rays").render(scene, RenderSettings())
    result.save_maps(tmp_path)
    y, x = np.argwhere((exact_coverage() > 0.3) & (exact_coverage() < 0.7))[10]
    np.testing.assert_allclose(read_image(tmp_path / "front.png")[y, x], FRONT, atol=0.1)
    np.testing.assert_allclose(read_image(tmp_path / "back.png")[y, x], BACK, atol=0.1)
    assert (tmp_path / "coverage.png").exists()
    assert read_image(tmp_path / "front.png")[0, 0].max() == 0
    fine = make_scene(planes(4)[0], DefocusMap(map=np.where(planes(4)[1], 6.0, 0.0)), supersampled=4)
    BokehRenderer("rays").render(fine, RenderSettings()).save_maps(tmp_path / "fine")
    assert read_image(tmp_path / "fine" / "front.png").shape == (2 * HEIGHT, 2 * WIDTH, 3)
    BokehRenderer("scatter").render(scene, RenderSettings()).save_maps(tmp_path / "scatter")
    assert not (tmp_path / "scatter" / "front.png").exists()


@pytest.fixture
def files(tmp_path):
    write_image(tmp_path / "photo.exr", filtered()[0])
    write_map(tmp_path / "z.exr", np.where(share_of_front(1), 2.0, 5.0).astype(np.float32), channel="Z")
    return tmp_path


def read(folder: Path, **given):
    told = InputSettings(depth=folder / "z.exr", **given)
    return read_scene(folder / "photo.exr", RenderSettings(input=told, camera=CAMERA))


def test_a_matte_is_read_from_alpha_or_grey(files):
    matte = exact_coverage()
    write_map(files / "grey.png", matte)
    write_image(
        files / "cut.png", np.full((HEIGHT, WIDTH, 3), 0.5, np.float32) * matte[..., None], alpha=matte
    )
    write_map(files / "matte.exr", matte, channel="A")
    for name in ("grey.png", "cut.png", "matte.exr"):
        np.testing.assert_allclose(read(files, matte=files / name).matte, matte, atol=0.005)


@pytest.mark.parametrize(
    ("matte", "error", "message"),
    [
        (
            np.full((HEIGHT, WIDTH), 1.5),
            ImageFileError,
            "expected a matte of 0 to 1, found 1.5 to 1.5; clip it",
        ),
        (
            np.full((HEIGHT, WIDTH), np.nan),
            ImageFileError,
            "of 0 to 1, found 3072 values that are NaN or infinite",
        ),
        (np.ones((HEIGHT, 10)), ShapeError, "the picture is 64x48 pixels but its matte is 10x48"),
    ],
)
def test_bad_mattes_are_refused(files, matte, error, message):
    write_exr(files / "matte.exr", {"channels": {"Y": ("float", matte)}})
    with pytest.raises(error, match=message):
        read(files, matte=files / "matte.exr")
    image, source = np.ones((HEIGHT, WIDTH, 3)), DefocusMap(map=np.zeros((HEIGHT, WIDTH)))
    with pytest.raises(BokehnetError, match="matte"):
        make_scene(image, source, matte=matte)


def test_what_does_not_go_with_supersampling_is_refused(files):
    with pytest.raises(ParameterError, match=r"input.supersampled: expected 1, 2 or 4, got 3"):
        InputSettings(supersampled=3)
    with pytest.raises(ParameterError, match=r"input.matte: expected no `input.supersampled`"):
        InputSettings(supersampled=2, matte="matte.png")
    image, source = np.ones((9, 12, 3)), DefocusMap(map=np.zeros((9, 12)))
    expected = r"input.supersampled: expected a picture with sides divisible by 2, got 12x9 pixels; crop it"
    with pytest.raises(ParameterError, match=expected):
        make_scene(image, source, supersampled=2)
    window = Window(x=1, y=0, width=12, height=8, display_width=16, display_height=8)
    with pytest.raises(ParameterError, match="got 12x8 pixels at 1,0 of 16x8"):
        make_scene(np.ones((8, 12, 3)), DefocusMap(map=np.zeros((8, 12))), window=window, supersampled=2)
    scene = read(files, supersampled=4)
    with pytest.raises(ParameterError, match=r"depth.repair: expected auto or off for a scene whose edges"):
        BokehRenderer("rays").render(scene, RenderSettings(depth=DepthSettings(repair="on")))
    small = make_scene(np.ones((8, 12, 3)), DefocusMap(map=np.zeros((4, 6))), supersampled=4)
    with pytest.raises(ShapeError, match="the picture is 12x8 pixels but its map is 6x4"):
        BokehRenderer("rays").render(small, RenderSettings())


def test_a_supersampled_file_gives_a_small_one(files):
    told = InputSettings(depth=files / "z.exr", supersampled=4)
    settings = RenderSettings(input=told, camera=CAMERA, focus=FocusSettings(distance=2))
    result = BokehRenderer("rays").render(read_scene(files / "photo.exr", settings), settings)
    result.save(files / "out.exr")
    assert read_image(files / "out.exr").shape == (HEIGHT // 4, WIDTH // 4, 3)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "shot", "least"), [("s2_thin_fence", 0, 39.0), ("s8_crowd", 0, 40.0)])
def test_path_traced_scenes_gain(shared, scene, shot, least):
    """Edge PSNR, dB; without, the first is 36.9 and the second 39.7; all fine pixels give 40.4 and 41.0."""
    folder = shared(f"cycles/{scene}/image_4x.exr").parent
    known = list(path_traced_shots(folder))[shot]
    told = loads((folder / "scene.json").read_text())
    camera = CameraSettings(
        focal_length=told["focal_length_mm"],
        sensor_width=told["sensor_width_mm"],
        f_number=told["shots"][shot]["f_number"],
    )
    settings = RenderSettings(
        input=InputSettings(depth=folder / "depth_4x.exr", supersampled=4),
        camera=camera,
        focus=FocusSettings(distance=told["shots"][shot]["focus_distance_m"]),
    )
    renderer = BokehRenderer("rays", aperture=known.aperture)
    found = renderer.render(read_scene(folder / "image_4x.exr", settings), settings).bokeh
    assert compare(found, known.truth, known.defocus)["edge_psnr"] > least


def test_a_matte_leaves_alone_what_the_map_tells_as_well():
    """Two surfaces behind one front keep their depths, and pixels all front or all back keep theirs."""
    disparity = np.full((20, 24), 0.9, np.float32)
    disparity[:10, 12:], disparity[10:, 12:] = 0.1, 0.5
    matte = np.zeros((20, 24), np.float32)
    matte[:, :12], matte[:, 12] = 1, 0.3
    found = matte_surfaces(matte, disparity)
    assert found.columns.tolist() == [12] * 20
    np.testing.assert_array_equal(found.near, np.float32(0.9))
    np.testing.assert_array_equal(found.far, disparity[:, 12])


def test_a_matte_of_several_things_leaves_each_its_depth():
    """Grass close before a wall is neither the wall nor the fence that the matte holds too."""
    disparity = np.full((20, 24), 0.24, np.float32)
    disparity[:, 4:12], disparity[:, 12:14] = 0.7, 0.26
    matte = (disparity > 0.25).astype(np.float32)
    assert matte_surfaces(matte, disparity).columns.tolist() == []


def test_a_matte_moves_an_edge_that_the_map_has_elsewhere():
    disparity = np.where(np.arange(24) < 10, 0.9, 0.1).astype(np.float32)[None].repeat(5, 0)
    matte = np.where(np.arange(24) < 12, 1, 0).astype(np.float32)[None].repeat(5, 0)
    found = matte_surfaces(matte, disparity)
    assert sorted(set(found.columns.tolist())) == [10, 11]
    np.testing.assert_array_equal(found.coverage, 1)
    np.testing.assert_allclose(found.near, 0.9, rtol=1e-6)

"""Supersampled scenes, mattes and deep samples from files and arrays.

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
from tests.unit.io.exr.exr_files import write_deep, write_exr
from train.scores.evaluation_sets import path_traced_shots
from train.scores.metrics import compare

HEIGHT, WIDTH = 48, 64
FRONT, BACK = np.float32([0.9, 0.2, 0.1]), np.float32([0.1, 0.3, 0.8])


def front_samples(factor):
    """Return the samples on the front plane at ``factor`` times the size, (factor H, factor W), bool."""
    y, x = (np.mgrid[: factor * HEIGHT, : factor * WIDTH] + 0.5) / factor
    return x + 0.3 * y < 38.3


def planes(factor):
    front = front_samples(factor)
    return np.where(front[..., None], FRONT, BACK), front


def filtered(factor=8):
    """Return the pixel-filtered picture and the map at pixel centres, as a renderer writes them."""
    return downsample(planes(factor)[0], factor), front_samples(1)


def blurred(near, far, factor=8):
    """Return the truth: the exact front, blurred by a disc of ``near`` pixels, over a uniform wall."""
    front = front_samples(factor).astype(np.float64)
    reach = int(abs(near) * factor) + factor
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = (x * x + y * y <= max(abs(near) * factor, 0.5) ** 2).astype(np.float64)
    padded = np.pad(front, reach, "edge")
    size = [n + len(disc) - 1 for n in padded.shape]
    spread = np.fft.irfft2(np.fft.rfft2(padded, size) * np.fft.rfft2(disc / disc.sum(), size), size)
    blurred_front = spread[2 * reach :, 2 * reach :][: front.shape[0], : front.shape[1]]
    coverage = downsample(blurred_front.astype(np.float32), factor)[..., None]
    return coverage * FRONT + (1 - coverage) * BACK


def inner_error(result, truth):
    """Return the root mean square error away from the border, where renderers extrapolate."""
    inside = np.s_[14:-14, 14:-14]
    return float(np.sqrt(np.mean((result[inside] - truth[inside]) ** 2)))


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


def test_the_pixel_filter_of_the_settings_is_used():
    """In focus, the result is the fine picture through this filter."""
    rng = np.random.default_rng(0)
    image = rng.random((2 * HEIGHT, 2 * WIDTH, 3), dtype=np.float32)
    scene = make_scene(image, DefocusMap(map=np.zeros((2 * HEIGHT, 2 * WIDTH))), supersampled=2)
    options = DepthSettings(pixel_filter="gaussian:2.6")
    result = BokehRenderer("rays").render(scene, RenderSettings(depth=options)).bokeh
    np.testing.assert_allclose(result, downsample(image, 2, PixelFilter("gaussian", 2.6)), atol=2e-6)


def test_blur_and_focus_are_in_pixels_of_the_result():
    """Map, focus and blur have the same meaning at all sizes."""
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


def test_distances_and_alpha_are_downsampled():
    image, front = planes(4)
    metres = np.where(front, 2.0, np.inf)
    camera = CameraSettings(focal_length=50, f_number=4, sensor_width=36)
    alpha = front.astype(np.float32)
    scene = make_scene(image * alpha[..., None], MetricDepth(map=metres), alpha=alpha, supersampled=4)
    settings = RenderSettings(camera=camera, focus=FocusSettings(distance=2))
    result = BokehRenderer("rays").render(scene, settings)
    assert result.alpha.shape == (HEIGHT, WIDTH)
    coverage = downsample(front_samples(8).astype(np.float32), 8)
    assert inner_error(result.alpha, coverage) < 0.02
    # Premultiplied light divided by alpha is the colour of the front.
    shown = result.alpha > 0.05
    np.testing.assert_allclose((result.bokeh[shown] / result.alpha[shown][:, None]).mean(0), FRONT, atol=0.02)


def exact_coverage():
    return downsample(front_samples(8).astype(np.float32), 8)


@pytest.mark.parametrize("shift", [0, -2])
def test_a_matte_corrects_the_position_of_an_edge(shift):
    """The edge of the map is ``shift`` pixels off, the front too small; the matte is exact."""
    small, centres = filtered()
    matte = exact_coverage()
    source = DefocusMap(map=np.roll(np.where(centres, 6.0, 0.0), shift, 1))
    truth = blurred(6.0, 0.0)
    with_matte = inner_error(rendered(make_scene(small, source, matte=matte)), truth)
    without = inner_error(rendered(make_scene(small, source)), truth)
    assert with_matte < (0.01 if shift == 0 else 0.3 * without)


def test_a_matte_without_full_coverage_defines_no_edge():
    """The front is then unknown; regression for maps above 0."""
    soft = np.tile(np.linspace(0, 0.9, WIDTH, dtype=np.float32), (HEIGHT, 1))
    assert len(matte_surfaces(soft, np.full((HEIGHT, WIDTH), 0.5, np.float32)).rows) == 0


def test_empty_and_full_mattes_change_nothing():
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
    """Write both planes at 2 m and 5 m; edge pixels have a sample of each."""
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


def test_deep_samples_define_the_surfaces(tmp_path):
    path = deep_file(tmp_path / "deep.exr")
    settings = RenderSettings(input=InputSettings(depth=path), camera=CAMERA, focus=FocusSettings(distance=5))
    scene = read_scene(path, settings)
    coverage = exact_coverage()
    position = scene.known.rows, scene.known.columns
    np.testing.assert_allclose(scene.known.coverage, coverage[position], atol=2e-3)
    np.testing.assert_allclose(scene.known.near, 1 / 2000, rtol=1e-5)
    np.testing.assert_allclose(scene.known.far, 1 / 5000, rtol=1e-5)
    np.testing.assert_allclose(scene.known.front, np.tile(FRONT, (len(position[0]), 1)), atol=0.01)
    np.testing.assert_allclose(scene.known.back, np.tile(BACK, (len(position[0]), 1)), atol=0.01)
    result = BokehRenderer("rays").render(scene, settings)
    radius = result.report.largest_blur
    assert radius > 3
    assert inner_error(result.bokeh, blurred(radius, 0.0)) < 0.009
    assert result.report.repaired is None
    with pytest.raises(ParameterError, match=r"depth.repair: expected auto or off for a scene whose edges"):
        BokehRenderer("rays").render(scene, settings.updated({"depth": {"repair": "on"}}))


def test_partially_covered_deep_pixels_have_no_background(tmp_path):
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
    write_map(tmp_path / "z.exr", np.where(front_samples(1), 2.0, 5.0).astype(np.float32), channel="Z")
    return tmp_path


def read(folder: Path, **inputs):
    options = InputSettings(depth=folder / "z.exr", **inputs)
    return read_scene(folder / "photo.exr", RenderSettings(input=options, camera=CAMERA))


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
def test_invalid_mattes_raise_errors(files, matte, error, message):
    write_exr(files / "matte.exr", {"channels": {"Y": ("float", matte)}})
    with pytest.raises(error, match=message):
        read(files, matte=files / "matte.exr")
    image, source = np.ones((HEIGHT, WIDTH, 3)), DefocusMap(map=np.zeros((HEIGHT, WIDTH)))
    with pytest.raises(BokehnetError, match="matte"):
        make_scene(image, source, matte=matte)


def test_inputs_that_conflict_with_supersampling_raise_errors(files):
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


def test_a_supersampled_file_renders_to_the_final_size(files):
    options = InputSettings(depth=files / "z.exr", supersampled=4)
    settings = RenderSettings(input=options, camera=CAMERA, focus=FocusSettings(distance=2))
    result = BokehRenderer("rays").render(read_scene(files / "photo.exr", settings), settings)
    result.save(files / "out.exr")
    assert read_image(files / "out.exr").shape == (HEIGHT // 4, WIDTH // 4, 3)


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "shot", "min_psnr"), [("s2_thin_fence", 0, 39.0), ("s8_crowd", 0, 40.0)])
def test_path_traced_scenes_improve(shared, scene, shot, min_psnr):
    """Bounds of edge PSNR, dB; 36.9 and 39.7 without supersampling, 40.4 and 41.0 with all fine pixels."""
    folder = shared(f"cycles/{scene}/image_4x.exr").parent
    known = list(path_traced_shots(folder))[shot]
    options = loads((folder / "scene.json").read_text())
    camera = CameraSettings(
        focal_length=options["focal_length_mm"],
        sensor_width=options["sensor_width_mm"],
        f_number=options["shots"][shot]["f_number"],
    )
    settings = RenderSettings(
        input=InputSettings(depth=folder / "depth_4x.exr", supersampled=4),
        camera=camera,
        focus=FocusSettings(distance=options["shots"][shot]["focus_distance_m"]),
    )
    renderer = BokehRenderer("rays", aperture=known.aperture)
    result = renderer.render(read_scene(folder / "image_4x.exr", settings), settings).bokeh
    assert compare(result, known.truth, known.defocus)["edge_psnr"] > min_psnr


def test_a_matte_keeps_edges_that_agree_with_the_map():
    """Two surfaces behind one front keep their depths, as do fully covered and uncovered pixels."""
    disparity = np.full((20, 24), 0.9, np.float32)
    disparity[:10, 12:], disparity[10:, 12:] = 0.1, 0.5
    matte = np.zeros((20, 24), np.float32)
    matte[:, :12], matte[:, 12] = 1, 0.3
    result = matte_surfaces(matte, disparity)
    assert result.columns.tolist() == [12] * 20
    np.testing.assert_array_equal(result.near, np.float32(0.9))
    np.testing.assert_array_equal(result.far, disparity[:, 12])


def test_a_matte_of_several_objects_keeps_their_depths():
    """Grass just in front of a wall is neither the wall nor the fence in the same matte."""
    disparity = np.full((20, 24), 0.24, np.float32)
    disparity[:, 4:12], disparity[:, 12:14] = 0.7, 0.26
    matte = (disparity > 0.25).astype(np.float32)
    assert matte_surfaces(matte, disparity).columns.tolist() == []


def test_a_matte_moves_an_edge_of_the_map():
    disparity = np.where(np.arange(24) < 10, 0.9, 0.1).astype(np.float32)[None].repeat(5, 0)
    matte = np.where(np.arange(24) < 12, 1, 0).astype(np.float32)[None].repeat(5, 0)
    result = matte_surfaces(matte, disparity)
    assert sorted(set(result.columns.tolist())) == [10, 11]
    np.testing.assert_array_equal(result.coverage, 1)
    np.testing.assert_allclose(result.near, 0.9, rtol=1e-6)

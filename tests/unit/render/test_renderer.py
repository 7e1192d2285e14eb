"""The renderer that people use. Authority: its two forms and its ways must agree bit for bit."""

import dataclasses
import pickle
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.effects import CameraEffects, Grain
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import BokehnetError, ParameterError, RenderCancelled, ShapeError
from bokehnet.io.channels import read_channels
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_map
from bokehnet.io.metadata.camera import Camera
from bokehnet.io.window import Window
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.tone import Highlights
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import ConstantDisparity, DefocusMap, MetricDepth, RelativeDisparity
from bokehnet.scene.scene import make_scene, read_scene
from bokehnet.settings.settings import (
    ApertureSettings,
    CameraSettings,
    DepthSettings,
    EffectSettings,
    EngineSettings,
    FocusSettings,
    HighlightSettings,
    InputSettings,
    LensSettings,
    OutputSettings,
    RenderSettings,
)
from bokehnet.settings.settings_file import load_settings

HALF = 2**-11  # relative rounding error of half floats
PLAIN = RenderSettings(
    camera=CameraSettings(blur=9),
    focus=FocusSettings(value=0.4),
    depth=DepthSettings(repair="off"),  # the picture is noise, nothing to follow
)


@pytest.fixture
def scene(photo, steps):
    return make_scene(photo, RelativeDisparity(map=steps, as_stored=True))


@pytest.fixture
def defocus(steps):
    return 9 * (steps - np.float32(0.4))


def with_groups(**groups):
    return dataclasses.replace(PLAIN, **groups)


@pytest.mark.parametrize("engine", ["scatter", "rays"])
def test_a_scene_and_its_arrays_give_the_same_bits(scene, photo, defocus, engine):
    renderer = BokehRenderer(engine)
    picture, expected = renderer.render(scene, PLAIN), renderer.render_arrays(photo, defocus)
    for name in ("bokeh", "classical", "error_map", "defocus"):
        assert_array_equal(getattr(picture, name), getattr(expected, name))
    assert picture.neural is None
    assert np.abs(picture.bokeh - photo).max() > 0.1


def test_the_networks_take_scenes_too(scene, photo, defocus, random_weights):
    renderer = BokehRenderer("fast", weights=random_weights)
    picture, expected = renderer.render(scene, PLAIN), renderer.render_arrays(photo, defocus)
    assert_array_equal(picture.bokeh, expected.bokeh)
    assert_array_equal(picture.neural, expected.neural)


def test_highlights_gamma_and_effects_are_those_of_the_library(scene, photo, defocus):
    light = HighlightSettings(threshold=0.7, gain=20, gamma=2)
    settings = with_groups(highlights=light, effects=EffectSettings(grain=3200))
    renderer = BokehRenderer("scatter")
    plain = renderer.render_arrays(
        photo, defocus, options=RenderOptions(gamma=2.0, highlights=Highlights(threshold=0.7, gain=20))
    ).bokeh
    picture = renderer.render(scene, settings)
    assert_array_equal(picture.bokeh, CameraEffects(grain=Grain(iso=3200.0)).apply(plain))
    assert_array_equal(picture.classical, plain)  # before the effects


def test_preparing_first_changes_no_bit(scene):
    renderer = BokehRenderer("scatter")
    prepared = renderer.prepare(scene, PLAIN)
    assert_array_equal(renderer.render(prepared, PLAIN).bokeh, renderer.render(scene, PLAIN).bokeh)
    assert prepared.lens.near == 0.4
    assert_array_equal(prepared.image, scene.image)


def test_one_prepared_scene_serves_many_looks(scene):
    renderer = BokehRenderer("scatter")
    prepared = renderer.prepare(scene, PLAIN)
    for blades in (0, 6):
        settings = with_groups(aperture=ApertureSettings(blades=blades))
        assert_array_equal(renderer.render(prepared, settings).bokeh, renderer.render(scene, settings).bokeh)


def test_the_repair_is_announced(scene):
    for mode, message in (("off", None), ("on", True)):
        settings = with_groups(depth=DepthSettings(repair=mode))
        report = BokehRenderer("scatter").render(scene, settings).report
        assert report.repaired is message
        assert bool(report.repair_reason) is (message is not None)
    auto = BokehRenderer("scatter").prepare(scene, with_groups(depth=DepthSettings()))
    assert auto.repaired in (True, False)
    assert auto.repair_reason


def test_what_settings_leave_at_their_default_is_as_the_renderer_was_made(scene, photo, defocus):
    """Authority: the array form, which knows no settings."""
    coma = LensResponse(aberration_map=AberrationSliders(coma=8.0).aberration_map())
    result = BokehRenderer("rays", aperture=Aperture(blades=5), lens_response=coma)
    assert_array_equal(result.render(scene, PLAIN).bokeh, result.render_arrays(photo, defocus).bokeh)
    # What settings do say takes its place, engine included.
    settings = with_groups(
        aperture=ApertureSettings(blades=7), lens=LensSettings(coma=-8), engine=EngineSettings(name="rays")
    )
    other = LensResponse(aberration_map=AberrationSliders(coma=-8.0).aberration_map())
    expected = BokehRenderer("rays", aperture=Aperture(blades=7), lens_response=other).render_arrays(
        photo, defocus
    )
    assert_array_equal(result.render(scene, settings).bokeh, expected.bokeh)
    with pytest.raises(ParameterError, match=r"engine.name: expected one that supports aberrations"):
        result.render(scene, with_groups(engine=EngineSettings(name="scatter")))
    disc = BokehRenderer("rays", aperture=Aperture(blades=5))
    picture = disc.render(scene, with_groups(engine=EngineSettings(name="scatter")))
    assert picture.report.engine == "scatter"
    scatter = BokehRenderer("scatter", aperture=Aperture(blades=5)).render_arrays(photo, defocus)
    assert_array_equal(picture.bokeh, scatter.bokeh)


def test_without_settings_a_ready_defocus_is_rendered(photo, defocus):
    scene = make_scene(photo, DefocusMap(map=defocus))
    renderer = BokehRenderer("scatter")
    picture = renderer.render(scene)
    assert_array_equal(picture.bokeh, renderer.render_arrays(photo, defocus).bokeh)
    assert (picture.report.focus_disparity, picture.report.focus_distance) == (None, None)


def test_a_report_names_the_decisions(scene, photo, steps):
    renderer = BokehRenderer("scatter")
    report = renderer.render(scene, PLAIN).report
    assert (report.engine, report.focus_disparity, report.focus_distance) == ("scatter", 0.4, None)
    assert report.largest_blur == pytest.approx(9 * 0.6)
    metres = np.where(steps > 0.5, 1, 4).astype(np.float32)
    camera = Camera(focal_length=50.0, f_number=2.0, sensor_width=36.0)
    settings = RenderSettings(focus=FocusSettings(range=(2, 4)), depth=DepthSettings(repair="off"))
    report = renderer.render(make_scene(photo, MetricDepth(map=metres), camera=camera), settings).report
    assert report.focus_distance == pytest.approx(2)
    assert report.focus_disparity == pytest.approx(1 / 2000)


def test_coverage_is_spread_as_the_light_is(photo, steps, defocus):
    """Oracle: a grey picture of the coverage, blurred by the same defocus."""
    alpha = np.zeros(photo.shape[:2], np.float32)
    alpha[10:30, 24:40] = 1
    scene = make_scene(photo * alpha[..., None], RelativeDisparity(map=steps, as_stored=True), alpha=alpha)
    renderer = BokehRenderer("scatter")
    picture = renderer.render(scene, PLAIN)
    grey = renderer.render_arrays(np.repeat(alpha[..., None], 3, -1), defocus).bokeh
    assert_allclose(picture.alpha, grey.mean(-1), atol=1e-6)
    assert picture.alpha.max() <= 1


def test_strips_give_the_same_picture(scene, monkeypatch):
    """Oracle: the whole picture at once; only rounding differs."""
    monkeypatch.setattr("bokehnet.render.exposure.memory_bounds.PROGRAM", 0)
    monkeypatch.setattr("bokehnet.engines.strips._FEWEST_ROWS", 1, raising=False)
    tall = np.random.default_rng(1).random((600, 48, 3), dtype=np.float32)
    ramp = np.linspace(0, 1, 600 * 48, dtype=np.float32).reshape(600, 48)
    tall_scene = make_scene(tall, RelativeDisparity(map=ramp, as_stored=True))
    calls = []
    settings = with_groups(engine=EngineSettings(max_memory=2_400_000))
    renderer = BokehRenderer("scatter")
    picture = renderer.render(tall_scene, settings, lambda *step: calls.append(step))
    assert calls[-1][1] > 1
    assert_allclose(picture.bokeh, renderer.render(tall_scene, PLAIN).bokeh, atol=1e-5)
    assert_array_equal(tall_scene.image, tall)


def test_progress_counts_up_to_the_end(scene):
    calls = []
    BokehRenderer("scatter").render(scene, PLAIN, lambda done, total: calls.append((done, total)))
    assert calls[0][0] == 0
    assert calls[-1][0] == calls[-1][1]
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)
    assert len({total for _, total in calls}) == 1


def test_a_cancelled_rendering_does_not_begin(scene, photo, defocus):
    cancel = threading.Event()
    cancel.set()
    renderer = BokehRenderer("scatter")
    calls = []
    for original in (scene, renderer.prepare(scene, PLAIN)):
        with pytest.raises(RenderCancelled):
            renderer.render(original, PLAIN, lambda *step: calls.append(step), cancel=cancel)
    with pytest.raises(RenderCancelled):
        renderer.render_arrays(photo, defocus, lambda *step: calls.append(step), cancel=cancel)
    with pytest.raises(RenderCancelled):
        renderer.prepare(scene, PLAIN, cancel=cancel)
    assert calls == []


@pytest.mark.parametrize("engine", ["scatter", "fast"])
def test_a_rendering_ends_when_it_is_cancelled_on_the_way(scene, engine, random_weights):
    cancel, calls = threading.Event(), []

    def progress(done, total):
        calls.append((done, total))
        cancel.set()

    renderer = BokehRenderer(engine, weights=random_weights)
    with pytest.raises(RenderCancelled):
        renderer.render(scene, PLAIN, progress, cancel=cancel)
    assert len(calls) == 1
    assert renderer.render(scene, PLAIN).bokeh.shape == scene.image.shape  # it is none the worse for it


def test_what_a_callback_raises_ends_the_rendering(scene):
    def progress(done, total):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        BokehRenderer("scatter").render(scene, PLAIN, progress)


@pytest.mark.parametrize("engine", ["scatter", "rays", "fast"])
def test_a_renderer_can_be_pickled(scene, engine, random_weights):
    weights = random_weights if engine == "fast" else None
    renderer = BokehRenderer(engine, aperture=Aperture(blades=6), weights=weights)
    expected = renderer.render(scene, PLAIN).bokeh
    copy = pickle.loads(pickle.dumps(renderer))
    assert (copy.engine, copy.aperture) == (renderer.engine, renderer.aperture)
    assert_array_equal(copy.render(scene, PLAIN).bokeh, expected)


def test_scenes_results_and_sources_can_be_pickled(folder, scene):
    settings = dataclasses.replace(PLAIN, input=InputSettings(disparity="disparity.png"))
    renderer = BokehRenderer("scatter")
    for one in (scene, read_scene("photo.exr", settings)):
        expected = renderer.render(one, PLAIN)
        assert_array_equal(renderer.render(pickle.loads(pickle.dumps(one)), PLAIN).bokeh, expected.bokeh)
        prepared = pickle.loads(pickle.dumps(renderer.prepare(one, PLAIN)))
        assert_array_equal(renderer.render(prepared, PLAIN).bokeh, expected.bokeh)
        copy = pickle.loads(pickle.dumps(expected))
        assert_array_equal(copy.bokeh, expected.bokeh)
        assert copy.report == expected.report
    assert pickle.loads(pickle.dumps(ConstantDisparity(value=0.5))).value == 0.5


@pytest.mark.parametrize("engine", ["scatter", "fast"])
def test_eight_threads_share_one_renderer_and_give_the_same_bits(scene, engine, random_weights):
    """Each thread has a look of its own, all of which are made inside the renderer."""
    weights = random_weights if engine == "fast" else None
    looks = [with_groups(aperture=ApertureSettings(blades=3 + number)) for number in range(8)]
    alone = [BokehRenderer(engine, weights=weights).render(scene, look).bokeh for look in looks]
    renderer = BokehRenderer(engine, weights=weights)
    gate = threading.Barrier(8)

    def work(look):
        gate.wait()
        return renderer.render(scene, look).bokeh

    with ThreadPoolExecutor(8) as pool:
        for one, other in zip(alone, pool.map(work, looks), strict=True):
            assert_array_equal(one, other)


def test_a_scene_is_left_as_it_was_unless_it_may_be_used_up(scene, photo, steps):
    settings = with_groups(
        engine=EngineSettings(max_memory=4 * 2**30), depth=DepthSettings(mixed="on", repair="on")
    )
    renderer = BokehRenderer("scatter")
    prepared = renderer.prepare(scene, settings)
    before = prepared.defocus.copy()
    first = renderer.render(prepared, settings)
    assert_array_equal(prepared.image, photo)
    assert_array_equal(prepared.defocus, before)
    assert_array_equal(scene.depth.values, steps)
    again = renderer.render(prepared, settings, overwrite=True)
    assert_array_equal(again.bokeh, first.bokeh)
    assert again.defocus is None


def test_a_picture_is_saved(scene, tmp_path):
    result = BokehRenderer("scatter").render(scene, PLAIN)
    result.save(tmp_path / "out.png")
    result.save(str(tmp_path / "out.exr"))
    assert_allclose(read_image(tmp_path / "out.exr"), result.bokeh, rtol=HALF, atol=1e-5)
    assert_allclose(read_image(tmp_path / "out.png"), result.bokeh, atol=0.01)
    with pytest.raises(BokehnetError, match=r"unknown extension '.gif'"):
        result.save(tmp_path / "out.gif")
    assert {path.name for path in tmp_path.iterdir()} == {"out.png", "out.exr"}


def test_an_exr_is_saved_in_place_of_the_picture_it_came_from(folder, write_channels, photo):
    colours = dict(zip("RGB", np.moveaxis(photo, 2, 0), strict=True))
    matte = np.random.default_rng(3).random(photo.shape[:2], dtype=np.float32)
    write_channels("layer.exr", **colours, matte=matte)
    settings = dataclasses.replace(PLAIN, input=InputSettings(disparity="disparity.png"))
    result = BokehRenderer("scatter").render(read_scene("layer.exr", settings), settings)
    result.save("layer.exr")
    channels = read_channels(folder / "layer.exr").channels
    assert set(channels) == {"R", "G", "B", "matte"}
    assert_array_equal(channels["matte"], matte)
    assert_allclose(channels["G"], result.bokeh[..., 1], rtol=HALF, atol=1e-5)


def test_the_saved_settings_reproduce_the_picture(folder, random_weights):
    settings = dataclasses.replace(
        PLAIN,
        input=InputSettings(disparity="disparity.png"),
        depth=DepthSettings(repair="on"),
        aperture=ApertureSettings(blades=6, cats_eye=0.5),
        effects=EffectSettings(grain=1600, vignette=1),
        engine=EngineSettings(name="fast", weights=random_weights),
        output=OutputSettings(save_maps="maps"),
    )
    result = BokehRenderer().render(read_scene("photo.exr", settings), settings)
    result.save_maps("maps", settings)
    names = {"classical.png", "defocus.exr", "defocus.png", "error_map.png", "neural.png", "settings.toml"}
    assert {path.name for path in (folder / "maps").iterdir()} == names
    again = load_settings("maps/settings.toml")
    assert again == settings
    assert_array_equal(BokehRenderer().render(read_scene("photo.exr", again), again).bokeh, result.bokeh)
    assert_array_equal(read_map("maps/defocus.exr"), result.defocus)
    grey = 0.5 + 0.5 * result.defocus / result.report.largest_blur
    assert_allclose(read_map("maps/defocus.png"), grey, atol=0.5 / 255 + 1e-6)


def test_maps_without_settings_have_no_file_of_them(scene, tmp_path):
    result = BokehRenderer("scatter").render(scene, PLAIN)
    result.save_maps(tmp_path / "deep" / "maps")
    assert not (tmp_path / "deep" / "maps" / "settings.toml").exists()
    (tmp_path / "file").touch()
    with pytest.raises(BokehnetError, match="cannot create the folder"):
        result.save_maps(tmp_path / "file")


def test_a_window_moves_what_is_centred(photo, steps):
    """Oracle: the same pixels cut out of a larger picture."""
    settings = with_groups(effects=EffectSettings(vignette=2))
    whole = BokehRenderer("scatter").render(
        make_scene(photo, RelativeDisparity(map=steps, as_stored=True)),
        with_groups(camera=CameraSettings(blur=0), effects=EffectSettings(vignette=2)),
    )
    window = Window(x=16, y=8, width=32, height=20, display_width=64, display_height=40)
    part = make_scene(
        photo[8:28, 16:48], RelativeDisparity(map=steps[8:28, 16:48], as_stored=True), window=window
    )
    sharp = dataclasses.replace(settings, camera=CameraSettings(blur=0))
    picture = BokehRenderer("scatter").render(part, sharp)
    assert_allclose(picture.bokeh, whole.bokeh[8:28, 16:48], atol=1e-6)


@pytest.mark.parametrize(
    ("settings", "parameter", "words"),
    [
        ({"camera": CameraSettings(sensor_width=36)}, "camera.sensor_width", "does not apply to"),
        ({"focus": FocusSettings(at=(64, 0))}, "focus.at", "inside the picture of 64x40"),
        ({"focus": FocusSettings(distance=2)}, "focus.distance", "does not apply to"),
        ({"lens": LensSettings(coma=2)}, "lens.coma", "rays or hybrid"),
        ({"highlights": HighlightSettings(gamma=2), "engine": EngineSettings(name="fast")}, "", ""),
    ],
)
def test_what_does_not_fit_is_refused_by_its_field(scene, settings, parameter, words, random_weights):
    renderer = BokehRenderer("scatter", weights=random_weights)
    if not parameter:
        parameter, words = "highlights.gamma", "expected 1, as in the training of the networks of fast"
    with pytest.raises(ParameterError, match=words) as caught:
        renderer.render(scene, with_groups(**settings))
    assert caught.value.parameter == parameter


def test_a_prepared_scene_is_no_way_round_the_checks(scene):
    renderer = BokehRenderer("scatter")
    prepared = renderer.prepare(scene, PLAIN)
    with pytest.raises(ParameterError, match="rays or hybrid"):
        renderer.render(prepared, with_groups(lens=LensSettings(coma=5)))


@pytest.mark.parametrize("wrong", ["settings", 5, {}, CameraSettings()])
def test_settings_have_no_other_keys(scene, wrong):
    for call in (BokehRenderer("scatter").render, BokehRenderer("scatter").prepare):
        with pytest.raises(ParameterError, match="settings: expected RenderSettings"):
            call(scene, wrong)


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        ({"image": np.zeros((4, 4))}, ShapeError, "image: expected shape"),
        ({"image": np.full((40, 64, 3), np.nan)}, ParameterError, "image: expected finite values"),
        ({"image": "photo.png"}, ParameterError, "image: expected an array"),
        ({"alpha": np.ones((3, 3))}, ShapeError, "image is 64x40 pixels but alpha is 3x3"),
        ({"alpha": np.full((40, 64), np.inf)}, ParameterError, "alpha: expected finite values"),
    ],
)
def test_arrays_that_make_no_scene_are_refused(photo, steps, change, kind, words):
    original = {"image": photo, "alpha": None} | change
    with pytest.raises(kind, match=words):
        make_scene(original["image"], RelativeDisparity(map=steps), alpha=original["alpha"])


def test_a_map_of_another_size_is_resized_on_request_only(photo, steps):
    scene = make_scene(photo, RelativeDisparity(map=steps[::2, ::2], as_stored=True))
    renderer = BokehRenderer("scatter")
    with pytest.raises(ShapeError, match=r"64x40 pixels but its disparity is 32x20.*`depth.resize`"):
        renderer.render(scene, PLAIN)
    picture = renderer.render(scene, with_groups(depth=DepthSettings(repair="off", resize=True)))
    assert_allclose(picture.defocus, 9 * (steps - np.float32(0.4)), atol=1e-5)


def test_an_unknown_engine_is_refused():
    with pytest.raises(
        ParameterError, match=r"engine: expected one of fast, hybrid, neural, rays, scatter, got 'magic'"
    ):
        BokehRenderer("magic")

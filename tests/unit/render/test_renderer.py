"""Public renderer. Authority: scenes and arrays must give the same bits."""

import dataclasses
import pickle
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.effects import CameraEffects, Grain
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
    depth=DepthSettings(repair="off"),  # the picture is noise without edges
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
    result, expected = renderer.render(scene, PLAIN), renderer.render(photo, defocus)
    for name in ("bokeh", "classical", "error_map", "defocus"):
        assert_array_equal(getattr(result, name), getattr(expected, name))
    assert result.neural is None
    assert np.abs(result.bokeh - photo).max() > 0.1


def test_networks_render_scenes_like_arrays(scene, photo, defocus, random_weights):
    renderer = BokehRenderer("fast", weights=random_weights)
    result, expected = renderer.render(scene, PLAIN), renderer.render(photo, defocus)
    assert_array_equal(result.bokeh, expected.bokeh)
    assert_array_equal(result.neural, expected.neural)


def test_highlights_gamma_and_effects_equal_the_library_functions(scene, photo, defocus):
    light = HighlightSettings(threshold=0.7, gain=20, gamma=2)
    settings = with_groups(highlights=light, effects=EffectSettings(grain=3200))
    renderer = BokehRenderer("scatter")
    plain = renderer.render(photo, defocus, gamma=2.0, highlights=Highlights(threshold=0.7, gain=20)).bokeh
    result = renderer.render(scene, settings)
    assert_array_equal(result.bokeh, CameraEffects(grain=Grain(iso=3200.0)).apply(plain))
    assert_array_equal(result.classical, plain)  # before the effects


def test_preparing_does_not_change_the_result(scene):
    renderer = BokehRenderer("scatter")
    prepared = renderer.prepare(scene, PLAIN)
    assert_array_equal(renderer.render(prepared, PLAIN).bokeh, renderer.render(scene, PLAIN).bokeh)
    assert prepared.lens.near == 0.4
    assert_array_equal(prepared.image, scene.image)


def test_a_prepared_scene_renders_several_apertures(scene):
    renderer = BokehRenderer("scatter")
    prepared = renderer.prepare(scene, PLAIN)
    for blades in (0, 6):
        settings = with_groups(aperture=ApertureSettings(blades=blades))
        assert_array_equal(renderer.render(prepared, settings).bokeh, renderer.render(scene, settings).bokeh)


def test_the_report_states_the_repair(scene):
    for mode, repaired in (("off", None), ("on", True)):
        settings = with_groups(depth=DepthSettings(repair=mode))
        report = BokehRenderer("scatter").render(scene, settings).report
        assert report.repaired is repaired
        assert bool(report.repair_reason) is (repaired is not None)
    auto = BokehRenderer("scatter").prepare(scene, with_groups(depth=DepthSettings()))
    assert auto.repaired in (True, False)
    assert auto.repair_reason


def test_default_settings_keep_the_options_of_the_renderer(scene, photo, defocus):
    """Authority: rendering of arrays, which does not read settings."""
    coma = LensResponse(aberration_map=AberrationSliders(coma=8.0).aberration_map())
    renderer = BokehRenderer("rays", aperture=Aperture(blades=5), lens_response=coma)
    assert_array_equal(renderer.render(scene, PLAIN).bokeh, renderer.render(photo, defocus).bokeh)
    # Explicit settings replace the options of the renderer, including the engine.
    settings = with_groups(
        aperture=ApertureSettings(blades=7), lens=LensSettings(coma=-8), engine=EngineSettings(name="rays")
    )
    other = LensResponse(aberration_map=AberrationSliders(coma=-8.0).aberration_map())
    expected = BokehRenderer("rays", aperture=Aperture(blades=7), lens_response=other).render(photo, defocus)
    assert_array_equal(renderer.render(scene, settings).bokeh, expected.bokeh)
    with pytest.raises(ParameterError, match=r"engine.name: expected one that supports aberrations"):
        renderer.render(scene, with_groups(engine=EngineSettings(name="scatter")))
    disc = BokehRenderer("rays", aperture=Aperture(blades=5))
    result = disc.render(scene, with_groups(engine=EngineSettings(name="scatter")))
    assert result.report.engine == "scatter"
    scatter = BokehRenderer("scatter", aperture=Aperture(blades=5)).render(photo, defocus)
    assert_array_equal(result.bokeh, scatter.bokeh)


def test_a_defocus_map_renders_without_settings(photo, defocus):
    scene = make_scene(photo, DefocusMap(map=defocus))
    renderer = BokehRenderer("scatter")
    result = renderer.render(scene)
    assert_array_equal(result.bokeh, renderer.render(photo, defocus).bokeh)
    assert (result.report.focus_disparity, result.report.focus_distance) == (None, None)


def test_the_report_states_engine_and_focus(scene, photo, steps):
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


def test_coverage_is_blurred_like_light(photo, steps, defocus):
    """Oracle: the coverage as a grey picture, blurred by the same defocus."""
    alpha = np.zeros(photo.shape[:2], np.float32)
    alpha[10:30, 24:40] = 1
    scene = make_scene(photo * alpha[..., None], RelativeDisparity(map=steps, as_stored=True), alpha=alpha)
    renderer = BokehRenderer("scatter")
    result = renderer.render(scene, PLAIN)
    grey = renderer.render(np.repeat(alpha[..., None], 3, -1), defocus).bokeh
    assert_allclose(result.alpha, grey.mean(-1), atol=1e-6)
    assert result.alpha.max() <= 1


def test_strips_give_the_same_picture(scene, monkeypatch):
    """Oracle: the whole picture without strips; only rounding differs."""
    monkeypatch.setattr("bokehnet.render.memory_bounds.PROGRAM", 0)
    monkeypatch.setattr("bokehnet.engines.strips._FEWEST_ROWS", 1, raising=False)
    tall = np.random.default_rng(1).random((600, 48, 3), dtype=np.float32)
    ramp = np.linspace(0, 1, 600 * 48, dtype=np.float32).reshape(600, 48)
    tall_scene = make_scene(tall, RelativeDisparity(map=ramp, as_stored=True))
    calls = []
    settings = with_groups(engine=EngineSettings(max_memory=1_900_000))
    renderer = BokehRenderer("scatter")
    result = renderer.render(tall_scene, settings, lambda *step: calls.append(step))
    assert calls[-1][1] > 1
    assert_allclose(result.bokeh, renderer.render(tall_scene, PLAIN).bokeh, atol=1e-5)
    assert_array_equal(tall_scene.image, tall)


def test_progress_increases_to_the_total(scene):
    calls = []
    BokehRenderer("scatter").render(scene, PLAIN, lambda done, total: calls.append((done, total)))
    assert calls[0][0] == 0
    assert calls[-1][0] == calls[-1][1]
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)
    assert len({total for _, total in calls}) == 1


def test_a_cancelled_render_does_not_start(scene, photo, defocus):
    cancel = threading.Event()
    cancel.set()
    renderer = BokehRenderer("scatter")
    calls = []
    for arguments in ((scene, PLAIN), (photo, defocus), (renderer.prepare(scene, PLAIN), PLAIN)):
        with pytest.raises(RenderCancelled):
            renderer.render(*arguments, lambda *step: calls.append(step), cancel=cancel)
    with pytest.raises(RenderCancelled):
        renderer.prepare(scene, PLAIN, cancel=cancel)
    assert calls == []


@pytest.mark.parametrize("engine", ["scatter", "fast"])
def test_a_running_render_can_be_cancelled(scene, engine, random_weights):
    cancel, calls = threading.Event(), []

    def progress(done, total):
        calls.append((done, total))
        cancel.set()

    renderer = BokehRenderer(engine, weights=random_weights)
    with pytest.raises(RenderCancelled):
        renderer.render(scene, PLAIN, progress, cancel=cancel)
    assert len(calls) == 1
    assert renderer.render(scene, PLAIN).bokeh.shape == scene.image.shape  # the renderer remains usable


def test_an_exception_of_a_callback_ends_the_render(scene):
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
    for source in (scene, read_scene("photo.exr", settings)):
        expected = renderer.render(source, PLAIN)
        assert_array_equal(renderer.render(pickle.loads(pickle.dumps(source)), PLAIN).bokeh, expected.bokeh)
        prepared = pickle.loads(pickle.dumps(renderer.prepare(source, PLAIN)))
        assert_array_equal(renderer.render(prepared, PLAIN).bokeh, expected.bokeh)
        copy = pickle.loads(pickle.dumps(expected))
        assert_array_equal(copy.bokeh, expected.bokeh)
        assert copy.report == expected.report
    assert pickle.loads(pickle.dumps(ConstantDisparity(value=0.5))).value == 0.5


@pytest.mark.parametrize("engine", ["scatter", "fast"])
def test_eight_threads_share_one_renderer_and_give_the_same_bits(scene, engine, random_weights):
    """Each thread renders another aperture."""
    weights = random_weights if engine == "fast" else None
    looks = [with_groups(aperture=ApertureSettings(blades=3 + number)) for number in range(8)]
    sequential = [BokehRenderer(engine, weights=weights).render(scene, look).bokeh for look in looks]
    renderer = BokehRenderer(engine, weights=weights)
    gate = threading.Barrier(8)

    def work(look):
        gate.wait()
        return renderer.render(scene, look).bokeh

    with ThreadPoolExecutor(8) as pool:
        for expected, bokeh in zip(sequential, pool.map(work, looks), strict=True):
            assert_array_equal(expected, bokeh)


def test_a_scene_does_not_change_without_overwrite(scene, photo, steps):
    settings = with_groups(
        engine=EngineSettings(max_memory=4 * 2**30), depth=DepthSettings(mixed="on", repair="on")
    )
    renderer = BokehRenderer("scatter")
    prepared = renderer.prepare(scene, settings)
    original = prepared.defocus.copy()
    first = renderer.render(prepared, settings)
    assert_array_equal(prepared.image, photo)
    assert_array_equal(prepared.defocus, original)
    assert_array_equal(scene.depth.values, steps)
    second = renderer.render(prepared, settings, overwrite=True)
    assert_array_equal(second.bokeh, first.bokeh)
    assert second.defocus is None


def test_results_are_saved(scene, tmp_path):
    result = BokehRenderer("scatter").render(scene, PLAIN)
    result.save(tmp_path / "out.png")
    result.save(str(tmp_path / "out.exr"))
    assert_allclose(read_image(tmp_path / "out.exr"), result.bokeh, rtol=HALF, atol=1e-5)
    assert_allclose(read_image(tmp_path / "out.png"), result.bokeh, atol=0.01)
    with pytest.raises(BokehnetError, match=r"unknown extension '.gif'"):
        result.save(tmp_path / "out.gif")
    assert {path.name for path in tmp_path.iterdir()} == {"out.png", "out.exr"}


def test_an_exr_can_overwrite_its_input_and_keeps_other_channels(folder, write_channels, photo):
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


def test_saved_settings_reproduce_the_picture(folder, random_weights):
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
    loaded = load_settings("maps/settings.toml")
    assert loaded == settings
    assert_array_equal(BokehRenderer().render(read_scene("photo.exr", loaded), loaded).bokeh, result.bokeh)
    assert_array_equal(read_map("maps/defocus.exr"), result.defocus)
    grey = 0.5 + 0.5 * result.defocus / result.report.largest_blur
    assert_allclose(read_map("maps/defocus.png"), grey, atol=0.5 / 255 + 1e-6)


def test_maps_without_settings_have_no_settings_file(scene, tmp_path):
    result = BokehRenderer("scatter").render(scene, PLAIN)
    result.save_maps(tmp_path / "deep" / "maps")
    assert not (tmp_path / "deep" / "maps" / "settings.toml").exists()
    (tmp_path / "file").touch()
    with pytest.raises(BokehnetError, match="cannot create the folder"):
        result.save_maps(tmp_path / "file")


def test_effects_are_centred_on_the_display_window(photo, steps):
    """Oracle: a crop of the whole picture."""
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
    result = BokehRenderer("scatter").render(part, sharp)
    assert_allclose(result.bokeh, whole.bokeh[8:28, 16:48], atol=1e-6)


@pytest.mark.parametrize(
    ("settings", "parameter", "message"),
    [
        ({"camera": CameraSettings()}, "camera.blur", "needs `camera.blur`"),
        ({"focus": FocusSettings()}, "focus.value", "one of `focus.value`"),
        ({"focus": FocusSettings(at=(64, 0))}, "focus.at", "inside the picture of 64x40"),
        ({"focus": FocusSettings(distance=2)}, "focus.distance", "does not apply to"),
        ({"lens": LensSettings(coma=2)}, "lens.coma", "rays or hybrid"),
        ({"highlights": HighlightSettings(gamma=2), "engine": EngineSettings(name="fast")}, "", ""),
    ],
)
def test_unsuitable_settings_raise_errors_with_their_field(
    scene, settings, parameter, message, random_weights
):
    renderer = BokehRenderer("scatter", weights=random_weights)
    if not parameter:
        parameter, message = "highlights.gamma", "expected 1, as in the training of the networks of fast"
    with pytest.raises(ParameterError, match=message) as caught:
        renderer.render(scene, with_groups(**settings))
    assert caught.value.parameter == parameter


def test_prepared_scenes_are_checked_too(scene):
    renderer = BokehRenderer("scatter")
    prepared = renderer.prepare(scene, PLAIN)
    with pytest.raises(ParameterError, match="rays or hybrid"):
        renderer.render(prepared, with_groups(lens=LensSettings(coma=5)))


@pytest.mark.parametrize("value", ["settings", 5, {}, CameraSettings()])
def test_other_types_of_settings_raise_errors(scene, value):
    for call in (BokehRenderer("scatter").render, BokehRenderer("scatter").prepare):
        with pytest.raises(ParameterError, match="settings: expected RenderSettings"):
            call(scene, value)


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"image": np.zeros((4, 4))}, ShapeError, "image: expected shape"),
        ({"image": np.full((40, 64, 3), np.nan)}, ParameterError, "image: expected finite values"),
        ({"image": "photo.png"}, ParameterError, "image: expected an array"),
        ({"alpha": np.ones((3, 3))}, ShapeError, "image is 64x40 pixels but alpha is 3x3"),
        ({"alpha": np.full((40, 64), np.inf)}, ParameterError, "alpha: expected finite values"),
    ],
)
def test_invalid_arrays_raise_errors(photo, steps, change, kind, message):
    arguments = {"image": photo, "alpha": None} | change
    with pytest.raises(kind, match=message):
        make_scene(arguments["image"], RelativeDisparity(map=steps), alpha=arguments["alpha"])


def test_a_map_of_another_size_is_resized_only_on_request(photo, steps):
    scene = make_scene(photo, RelativeDisparity(map=steps[::2, ::2], as_stored=True))
    renderer = BokehRenderer("scatter")
    with pytest.raises(ShapeError, match=r"64x40 pixels but its disparity is 32x20.*`depth.resize`"):
        renderer.render(scene, PLAIN)
    result = renderer.render(scene, with_groups(depth=DepthSettings(repair="off", resize=True)))
    assert_allclose(result.defocus, 9 * (steps - np.float32(0.4)), atol=1e-5)


def test_an_unknown_engine_raises_an_error():
    with pytest.raises(
        ParameterError, match=r"engine: expected one of fast, hybrid, neural, rays, scatter, got 'magic'"
    ):
        BokehRenderer("magic")

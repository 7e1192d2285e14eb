"""Renders of a picture that the renderer knows, checked bit by bit against fresh renders."""

import pickle
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.errors import ParameterError
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import DefocusMap, MetricDepth, RelativeDisparity
from bokehnet.scene.preparation.picture_cache import PictureCache, array_digest
from bokehnet.scene.scene import make_scene
from bokehnet.settings.settings import FocusSettings, RenderSettings
from tests.unit.conftest import HEIGHT, WIDTH, displaced_card

SETTINGS = RenderSettings().updated({"camera": {"blur": 12}, "focus": {"value": 0.7}})


@pytest.fixture(scope="module")
def scene():
    """Card in front of a texture, whose map lies four pixels beside the card."""
    image, values = displaced_card()
    return make_scene(image, RelativeDisparity(map=values, as_stored=True))


@pytest.mark.parametrize("engine", ["rays", "scatter"])
def test_another_focus_equals_a_fresh_render_without_another_repair(scene, repairs, engine):
    renderer = BokehRenderer(engine)
    renderer.render(scene, SETTINGS)
    assert len(repairs) == 1
    for focus in (0.1, 0.45):
        again = renderer.render(scene, SETTINGS, focus=focus)
        assert len(repairs) == 1
        fresh = BokehRenderer(engine, cache_bytes=0).render(
            scene, SETTINGS.updated({"focus": {"value": focus}})
        )
        assert_array_equal(again.bokeh, fresh.bokeh)
        assert again.report == fresh.report
        del repairs[1:]


def test_a_focused_scene_focuses_again(scene, repairs):
    renderer = BokehRenderer("scatter")
    focused = renderer.prepare(scene, SETTINGS)
    for one in (focused, pickle.loads(pickle.dumps(focused))):
        moved = one.refocus(0.2).refocus(at=(45, 30))
        fresh = renderer.prepare(scene, replace(SETTINGS, focus=FocusSettings(at=(45, 30))))
        assert_array_equal(moved.defocus, fresh.defocus)
        rendered = renderer.render(one, SETTINGS, focus=FocusSettings(at=(45, 30)))
        assert_array_equal(rendered.defocus, fresh.defocus)
    assert one.refocus().lens.subject is not None
    assert len(repairs) == 1


def test_metric_depth_focuses_again_in_metres():
    depth = np.full((HEIGHT, WIDTH), 4.0, np.float32)
    depth[:, :40] = 2
    lens = {"camera": {"focal_length": 50, "f_number": 2, "sensor_width": 36}, "focus": {"distance": 4}}
    settings, renderer = RenderSettings().updated(lens), BokehRenderer("scatter")
    scene = make_scene(np.ones((HEIGHT, WIDTH, 3), np.float32), MetricDepth(map=depth))
    assert renderer.prepare(scene, settings).refocus(2.0).lens.distance == pytest.approx(2)
    assert renderer.render(scene, settings, focus=2.0).report.focus_distance == pytest.approx(2)


def test_what_the_repair_depends_on_misses_the_cache(scene, repairs):
    renderer = BokehRenderer("scatter")
    renderer.render(scene, SETTINGS)
    renderer.render(scene, SETTINGS.updated({"depth": {"repair": "on"}}))
    assert len(repairs) == 2
    image = scene.image.copy()
    other = make_scene(image, RelativeDisparity(map=scene.depth.values, as_stored=True))
    renderer.render(other, SETTINGS)  # equal arrays
    assert len(repairs) == 2
    other.image[5, 5] = 0
    renderer.render(other, SETTINGS)  # changed in place
    assert len(repairs) == 3


def copy_of(scene):
    """Return a scene with equal arrays of its own."""
    source = RelativeDisparity(map=scene.depth.values.copy(), as_stored=True)
    return make_scene(scene.image.copy(), source)


def test_a_render_that_overwrites_its_scene_leaves_the_kept_picture_intact(scene, repairs):
    bounded = {"engine": {"max_memory": "2G"}, "highlights": {"threshold": 0.5}}  # brightens in place
    settings, renderer = SETTINGS.updated(bounded), BokehRenderer("scatter")
    first, second = (
        renderer.render(renderer.prepare(copy_of(scene), settings), settings, overwrite=True).bokeh.copy()
        for _ in range(2)
    )
    assert_array_equal(first, second)
    assert len(repairs) == 1


def test_a_map_that_its_owner_changes_leaves_the_kept_one_intact(scene):
    settings, renderer = SETTINGS.updated({"depth": {"repair": "off"}}), BokehRenderer("scatter")
    changed = copy_of(scene)
    first = renderer.render(changed, settings).bokeh
    changed.depth.values[:] = 0
    assert_array_equal(renderer.render(copy_of(scene), settings).bokeh, first)


@pytest.mark.parametrize("engine", ["rays", "scatter"])
def test_a_renderer_keeps_no_picture_beyond_its_bound(scene, engine):
    renderer = BokehRenderer(engine)
    passing = copy_of(scene)
    image = weakref.ref(passing.image)
    renderer.render(passing, SETTINGS)
    del passing
    assert image() is None
    assert renderer._pictures.nbytes < 3 * scene.image.nbytes


def test_threads_and_pickles_render_the_same_bits(scene):
    renderer = BokehRenderer("scatter")
    values = [0.1, 0.3, 0.5, 0.7] * 2
    expected = [renderer.render(scene, SETTINGS, focus=value).bokeh for value in values[:4]]
    fresh = pickle.loads(pickle.dumps(renderer))
    with ThreadPoolExecutor(4) as pool:
        actual = list(pool.map(lambda value: fresh.render(scene, SETTINGS, focus=value).bokeh, values))
    for index, bokeh in enumerate(actual):
        assert_array_equal(bokeh, expected[index % 4])


def test_the_cache_keeps_within_its_bound():
    cache = PictureCache(10_000)
    for index in range(6):
        cache.get(index, lambda: np.zeros(1000, np.float32))
        assert cache.nbytes <= 10_000
    results = []
    cache.get(5, lambda: results.append(5))  # the latest is kept
    cache.get(0, lambda: results.append(0))
    cache.get("large", lambda: np.zeros(10_000, np.float32))
    cache.get("large", lambda: results.append("large"))
    assert results == [0, "large"]


def test_digests_depend_on_every_value_and_the_shape():
    array = np.random.default_rng(0).uniform(size=(4, 6)).astype(np.float32)
    changed = array.copy()
    changed[3, 5] += 1e-6
    digests = {array_digest(x) for x in (array, changed, array.reshape(6, 4), array.astype(np.float64))}
    assert len(digests) == 4
    assert array_digest(array[:, ::2]) == array_digest(array[:, ::2].copy())


def test_scenes_that_cannot_focus_again_say_why(scene):
    flat = make_scene(scene.image, DefocusMap(map=scene.depth.values))
    with pytest.raises(ParameterError, match="already focused"):
        BokehRenderer("scatter").prepare(flat).refocus(0.2)
    with pytest.raises(ParameterError, match="keeps pictures"):
        BokehRenderer("scatter", cache_bytes=0).prepare(scene, SETTINGS).refocus(0.2)

"""Kernels are loaded in a thread while the map is repaired, and never compiled there."""

import time

import numba
import numpy as np

from bokehnet.cli.render.warming import loading_kernels
from bokehnet.render.renderer import BokehRenderer
from bokehnet.settings.settings import EngineSettings, RenderSettings

SETTINGS = RenderSettings(engine=EngineSettings(name="scatter"))


class Renderer(BokehRenderer):
    """One whose warming-up is a kernel that no cache holds."""

    def warm_up(self, settings=None):
        self.asked, self.kernel = settings, numba.njit(lambda x: 2 * x)
        self.kernel(1)
        self.compiled = True


def test_what_no_cache_holds_is_left_to_the_picture():
    renderer = Renderer("scatter")
    with loading_kernels(renderer, SETTINGS):
        time.sleep(0)
    assert renderer.asked == SETTINGS
    assert not hasattr(renderer, "compiled")
    assert len(renderer.kernel.overloads) == 0
    assert renderer.kernel(2) == 4  # here it is


def test_the_picture_is_the_same(folder, cli):
    """Oracle: the renderer, which loads kernels as they are called."""
    words = ("--disparity", "disparity.png", "--blur", 6, "--focus", 0.4, "--blades", 6, "-q")
    assert cli("render", "photo.png", *words, "-o", "out.exr").code == 0
    from bokehnet.io.image import read_image
    from bokehnet.scene.scene import read_scene

    reports = {"camera": {"blur": 6}, "focus": {"value": 0.4}, "aperture": {"blades": 6}}
    settings = RenderSettings().updated({"input": {"disparity": "disparity.png"}, **reports})
    expected = BokehRenderer().render(read_scene("photo.png", settings), settings).bokeh.astype(np.float16)
    np.testing.assert_array_equal(read_image("out.exr"), expected)


def test_a_mistake_is_reported_once(capfd):
    class Broken(Renderer):
        def warm_up(self, settings=None):
            raise ZeroDivisionError

    with loading_kernels(Broken("scatter"), SETTINGS):
        pass
    assert capfd.readouterr().err == ""

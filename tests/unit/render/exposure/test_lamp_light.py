"""Settings of light: effects, defaults and errors."""

import dataclasses

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.optics.spectral.diffraction import ring_kernel
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import DefocusMap
from bokehnet.scene.scene import make_scene
from bokehnet.settings.settings import RenderSettings

HEIGHT, WIDTH = 90, 120


def rendered(settings, radius=-15.0, lens=None):
    image = np.full((HEIGHT, WIDTH, 3), 0.05, np.float32)
    image[40, 55] = 200
    depth = DefocusMap(map=np.full((HEIGHT, WIDTH), radius, np.float32))
    changes = {"light": settings} if lens is None else {"light": settings, "lens": lens}
    return BokehRenderer("scatter").render(make_scene(image, depth), RenderSettings().updated(changes)).bokeh


def test_all_effects_are_off_by_default():
    plain = rendered({})
    assert RenderSettings().light == type(RenderSettings().light)()
    for settings in ({"rings": 2.8}, {"starburst": 16}, {"glare": 0.02}):
        changed = rendered(settings)
        assert np.abs(changed - plain).max() > 1e-3
        np.testing.assert_allclose(changed.mean((0, 1)), plain.mean((0, 1)), rtol=0.02)


def test_rings_depend_on_the_pixel_pitch():
    plain, result = rendered({}), rendered({"rings": 4, "pixel_pitch": 10})
    kernel = ring_kernel(BokehRenderer("scatter").aperture, -15.0, 0.4)
    half = len(kernel) // 2
    cut = result[40 - half : 40 + half + 1, 55 - half : 55 + half + 1]
    assert np.corrcoef(cut[..., 1].ravel(), kernel[..., 1].ravel())[0, 1] > 0.99
    assert np.abs(result - plain).max() > 0.02 * plain.max()


@pytest.mark.parametrize(
    ("group", "message"),
    [
        (
            {"pixel_pitch": 4},
            "light.pixel_pitch: expected `light.rings` or `light.starburst` for it to act on",
        ),
        ({"glare_core": 1}, "light.glare_core: expected `light.glare` for it to act on"),
        ({"lamps": 2}, "light.lamps: expected `light.rings`, `light.starburst` or `light.ghosts`"),
        ({"ghosts": "single"}, "light.ghosts: expected `lens.name`, whose surfaces reflect"),
        ({"rings": 0.1}, "light.rings: expected 0.5 to 64, got 0.1"),
    ],
)
def test_settings_without_effect_raise_errors(group, message):
    with pytest.raises(ParameterError) as caught:
        RenderSettings().updated({"light": group})
    assert message in str(caught.value)


def test_ghosts_need_a_lens():
    image = np.full((HEIGHT, WIDTH, 3), 0.05, np.float32)
    image[30, 40] = 1e5
    from bokehnet.scene.depth.depth_source import RelativeDisparity

    scene = make_scene(image, RelativeDisparity(map=np.ones((HEIGHT, WIDTH), np.float32)))
    settings = RenderSettings().updated(
        {"lens": {"name": "cooke_triplet", "aberrations": "seidel", "vignetting": False},
         "camera": {"blur": 8}, "focus": {"value": 1.0}, "depth": {"repair": "off"}}
    )  # fmt: skip
    renderer = BokehRenderer("rays")
    plain = renderer.render(scene, settings).bokeh
    with_ghosts = dataclasses.replace(settings, light=settings.updated({"light": {"ghosts": "none"}}).light)
    ghosts = renderer.render(scene, with_ghosts).bokeh - plain
    assert ghosts.min() > -1e-3 * plain.max()
    assert ghosts.sum() > 10

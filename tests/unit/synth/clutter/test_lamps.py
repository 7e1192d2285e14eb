import numpy as np
import pytest

from bokehnet.lenses import ThinLens
from bokehnet.synth.clutter.baked_scene import BakedScene, View, make_soup, pack
from bokehnet.synth.clutter.grid_mesh import plate
from bokehnet.synth.clutter.lamps import Lamp, add_lamps, lamp_body

pytest.importorskip("embreex", reason="Embree is not installed: pip install 'bokehnet[trace]'")

PITCH = 36 / 96
VIEW = View(width=96, height=96, pixel_pitch=PITCH, samples=1, seed=0)
# 50 mm behind the lens; a pixel is 0.0075 of the depth.
PIXEL = PITCH / 50
WHITE = np.ones(3)


def scene_of(meshes):
    return BakedScene(
        soup=make_soup(meshes, 1.0),
        albedo=pack([np.zeros((1, 1, 3))]),
        light=pack([np.ones((2, 2, 3))] * len(meshes)),
        texture=np.zeros(len(meshes), np.int64),
        sky=np.zeros((2, 2, 3), np.float32),
        sky_half=(1.0, 1.0),
    )


def lens_for(blur, depth, focus=1500.0):
    """A lens that blurs what is at ``depth`` by ``blur`` pixels."""
    focal = 1 / (1 / 50 + 1 / focus)
    radius = blur * PITCH / 50 / abs(1 / depth - 1 / focus)
    return ThinLens(focal_length=focal, f_number=focal / 2 / radius, focus_distance=focus)


def light_of(lamp, lens, others=(), pupil=True):
    picture = np.zeros((96, 96, 3), np.float32)
    scene = scene_of([lamp_body(lamp, 0), *others])
    add_lamps(picture, scene, (lamp,), lens, VIEW, pupil)
    return picture[..., 0]


@pytest.mark.parametrize("blur", [0.4, 1.2, 4.0, 15.0])
@pytest.mark.parametrize("depth", [900.0, 4000.0])
def test_light_spreads_over_the_blur_disc_without_loss(blur, depth):
    """Authority: energy, and the second moment of a disc convolved with a disc and a pixel."""
    lamp = Lamp(centre=(0.02 * depth, -0.03 * depth, depth), radius=1.6 * PIXEL * depth, radiance=WHITE)
    seen = light_of(lamp, lens_for(blur, depth))
    assert seen.sum() == pytest.approx(np.pi * 1.6**2, rel=0.02)
    x, y = np.meshgrid(np.arange(96) + 0.5 - 48, np.arange(96) + 0.5 - 48)
    middle = np.array([(seen * x).sum(), (seen * y).sum()]) / seen.sum()
    assert middle == pytest.approx([0.02 / PIXEL, -0.03 / PIXEL], abs=0.1)
    spread = (seen * ((x - middle[0]) ** 2 + (y - middle[1]) ** 2)).sum() / seen.sum()
    assert spread == pytest.approx((1.6**2 + blur**2) / 2 + 1 / 6, rel=0.05)


def test_all_in_focus_lamp_is_a_sharp_disc():
    """Authority: its area."""
    lamp = Lamp(centre=(0.0, 0.0, 3000.0), radius=3 * PIXEL * 3000, radiance=7 * WHITE)
    seen = light_of(lamp, ThinLens(focal_length=50, f_number=1), pupil=False)
    assert seen.max() == pytest.approx(7.0)
    assert seen.sum() == pytest.approx(7 * np.pi * 9, rel=0.02)


def test_an_occluder_of_a_lamp_clips_its_disc():
    """Authority: a half plane in the lens's focus hides exactly the half of the picture that it covers."""
    lamp = Lamp(centre=(0.0, 0.0, 6000.0), radius=PIXEL * 6000, radiance=WHITE)
    edge = plate((0, -1e4, 1500.0), (1e4, 0, 0), (0, 2e4, 0), 0)
    free, clipped = (light_of(lamp, lens_for(14.0, 6000.0), others) for others in ((), (edge,)))
    assert not clipped[:, 48:].any()
    assert clipped[:, :48] == pytest.approx(free[:, :48])
    behind = plate((-1e4, -1e4, 6100.0), (2e4, 0, 0), (0, 2e4, 0), 0)
    assert np.array_equal(light_of(lamp, lens_for(14.0, 6000.0), (behind,)), free)


def test_lamp_outside_of_the_picture_adds_nothing():
    lamp = Lamp(centre=(6000.0, 0.0, 6000.0), radius=10.0, radiance=WHITE)
    assert not light_of(lamp, lens_for(5.0, 6000.0)).any()

import dataclasses
import math

import numpy as np
import pytest

from bokehnet.config import load_config
from bokehnet.errors import LensError, ParameterError
from bokehnet.optics.sampling import disc_from_square
from bokehnet.synth import SynthConfig
from bokehnet.synth.training_lenses import covered_slope, make_training_lens

FOCUS, PUPIL, DISTANCE = 3000.0, 40.0, 100.0


def beams(lens, sensor):
    """Rays of a 24 x 24 grid of the disc for each sensor point: origin, slope (P, S, 2), weight (P, S)."""
    grid = (np.arange(24) + 0.5) / 24
    disc = disc_from_square(np.stack(np.meshgrid(grid, grid), -1).reshape(-1, 2))
    points = np.repeat(np.asarray(sensor)[:, None], len(disc), 1)
    return lens.sample_rays(points, np.broadcast_to(disc, points.shape))


def mean_slope(rays, depth):
    place = rays.origin / depth + rays.slope
    return (place * rays.weight[..., None]).sum(1) / rays.weight.sum(1)[:, None]


@pytest.mark.parametrize("name", ["cooke_triplet", "double_gauss", "retrofocus"])
def test_sharp_surfaces_are_where_a_pinhole_shows_them(name):
    """Authority: the pinhole's perspective; what is left is coma, under 0.7 pixels of 256."""
    lens = make_training_lens(name, PUPIL, FOCUS, 1.0, DISTANCE)
    sensor = np.array([[0.0, 0.0], [9.0, 0.0], [-12.0, 12.0], [18.0, 18.0]])
    result = mean_slope(beams(lens, sensor), FOCUS)
    assert np.abs(result + sensor / DISTANCE).max() < 0.7 * 36 / 256 / DISTANCE


@pytest.mark.parametrize("depth", [1500.0, 8000.0])
def test_blur_is_that_of_the_requested_pupil(depth):
    """Authority: the blur formula; two stops closed, aberrations change it by a few percent."""
    lens = make_training_lens("double_gauss", PUPIL, FOCUS, 2.0, DISTANCE)
    rays = beams(lens, [[0.0, 0.0]])
    place = (rays.origin / depth + rays.slope)[0]
    passing = rays.weight[0] > 0
    radius = np.linalg.norm(place[passing], axis=-1)
    expected = PUPIL * abs(1 / depth - 1 / FOCUS)
    assert math.sqrt(2 * (radius**2).mean()) == pytest.approx(expected, rel=0.06)
    assert abs(lens.coc_radius(1 / depth)) == pytest.approx(expected * DISTANCE, rel=1e-3)


def test_sets_refuse_lenses_that_do_not_cover_the_picture_or_do_not_exist():
    config = load_config("configs/synth_clutter_tiny.toml", SynthConfig)
    assert covered_slope("retrofocus") == pytest.approx(0.76, abs=0.01)
    with pytest.raises(
        ParameterError, match=r"petzval, which covers slopes up to 0.150.*larger `sensor_distance`"
    ):
        dataclasses.replace(config, catalog=("petzval",), catalog_share=0.5)
    with pytest.raises(ParameterError, match="names no lens"):
        dataclasses.replace(config, catalog_share=0.5)
    with pytest.raises(ParameterError, match="kind: expected 'clutter'"):
        dataclasses.replace(config, kind="planes", catalog=("retrofocus",))
    with pytest.raises(LensError, match="unknown lens 'glass'"):
        dataclasses.replace(config, catalog=("glass",))
    with pytest.raises(LensError, match="cannot focus"):
        make_training_lens("retrofocus", 500.0, 1000.0, 0.0, 50.0)

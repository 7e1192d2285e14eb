"""Distorted pictures: light lands where the model sends it, no border shows, and nothing jumps."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.effects import BrownConrady, DivisionModel, Viewport, Warp
from bokehnet.errors import ParameterError

RNG = np.random.default_rng(0)
BARREL, PINCUSHION = DivisionModel(strength=-0.2), DivisionModel(strength=0.2)
BROWN = BrownConrady(radial=(-0.15, 0.05, 0.0), decentring=(0.01, -0.015))
MUSTACHE = BrownConrady(radial=(-0.4, 0.5, 0.0))
MODELS = [BARREL, PINCUSHION, BROWN, MUSTACHE, None]


def lamp(view, place, width=1.5):
    """A smooth dot at a field position."""
    x, y = view.places(np.asarray(place))
    rows, columns = np.mgrid[: view.height, : view.width]
    return np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * width**2))[..., None].repeat(3, -1)


def centroid(view, light):
    """Field position of the middle of the light, (H, W)."""
    field = view.field(slice(0, view.height), view.width, light)
    return (light[..., None] * field).sum((0, 1)) / light.sum()


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.5, 0.2), (-0.3, -0.4), (-0.55, 0.35)])
@pytest.mark.parametrize("model", MODELS[:4])
def test_light_lands_where_the_model_sends_it(model, place):
    """Authority: the model's own way from undistorted to distorted places, after the crop.

    The middle of a dot of some size is off by the bend of the map within it.
    """
    view = Viewport(width=160, height=120)
    image, warp = lamp(view, place), Warp(distortion=model)
    scale = warp.scale(image, view)
    expected = model.distort(np.asarray(place) / scale)
    result = centroid(view, warp.apply(image)[..., 1])
    assert_allclose(result, expected, atol=0.1 / view.half_diagonal)


def test_blue_goes_out_and_red_in():
    """Authority: the magnifications 1 - m / 2 and 1 + m / 2, after the crop."""
    view, place = Viewport(width=160, height=120), np.array([0.5, -0.3])
    image, warp = lamp(view, place), Warp(lateral=0.04)
    scale = warp.scale(image, view)
    result = warp.apply(image)
    for channel, magnification in enumerate((0.98, 1.0, 1.02)):
        actual = centroid(view, result[..., channel])
        assert_allclose(actual, place * magnification / scale, atol=0.02 / view.half_diagonal)


@pytest.mark.parametrize(("width", "height"), [(160, 120), (90, 160), (200, 30), (7, 5)])
@pytest.mark.parametrize("lateral", [0.0, 0.06])
@pytest.mark.parametrize("model", MODELS)
def test_no_border_shows_and_nothing_is_wasted(model, lateral, width, height):
    """With all light 1 the result is 1; a scale larger by 1 % looks beyond the picture."""
    warp, image = Warp(distortion=model, lateral=lateral), np.ones((height, width, 3))
    assert_allclose(warp.apply(image), 1, atol=1e-12)
    view = Viewport.of(image)
    border = view.border(image)
    looked = []
    for magnification in (1 - lateral / 2, 1.0, 1 + lateral / 2):
        d = border / magnification
        looked.append(
            view.places(1.01 * warp.scale(image, view) * (d if model is None else model.undistort(d)))
        )
    x, y = np.concatenate(looked).T
    assert min(x.min(), y.min(), width - 1 - x.max(), height - 1 - y.max()) < -1e-3


@pytest.mark.parametrize(("strength", "nearest"), [(-0.3, (79.5, 59.5)), (0.3, (0.5, 59.5))])
def test_the_crop_of_division_is_known(strength, nearest):
    """Arithmetic: the scale is 1 + K r^2, r the corner for a barrel, else the middle of the long side."""
    view = Viewport(width=160, height=120)
    radius = np.hypot(*nearest) / view.half_diagonal
    scale = Warp(distortion=DivisionModel(strength=strength)).scale(np.ones((120, 160, 3)), view)
    assert scale == pytest.approx(1 + strength * radius**2)


def smooth(height, width):
    rows, columns = np.mgrid[:height, :width]
    waves = [np.sin(columns / 7 + c) * np.cos(rows / 9 - c) for c in range(3)]
    return 0.5 + 0.4 * np.stack(waves, -1)


@pytest.mark.parametrize("lateral", [0.0, 0.04])
@pytest.mark.parametrize("model", MODELS)
def test_a_warp_is_undone_but_for_resampling_and_what_was_cropped(model, lateral):
    warp, image = Warp(distortion=model, lateral=lateral), smooth(120, 160)
    back = warp.undo(warp.apply(image))
    inner = slice(40, 80), slice(50, 110)
    assert np.abs(back - image)[inner].max() < 0.01
    assert np.abs(warp.apply(image) - image)[inner].max() > 0.05 or (model is None and lateral == 0)
    if model is BARREL and lateral == 0:
        assert_array_equal(back[0, 80], 0)


@pytest.mark.parametrize("model", [BARREL, PINCUSHION, MUSTACHE])
def test_overscan_takes_the_place_of_the_crop(model):
    """Enough of it: no scale but a pincushion's own; light as from a picture without border."""
    margin = 60
    image = smooth(120 + 2 * margin, 160 + 2 * margin)
    view = Viewport(width=160, height=120, left=-margin, top=-margin)
    warp = Warp(distortion=model)
    scale = warp.scale(image, view)
    cropped = warp.scale(np.ones((120, 160, 3)), Viewport(width=160, height=120))
    assert scale == pytest.approx(max(1, cropped))
    field = Viewport(width=160, height=120).field(slice(0, 120), 160, image)
    x, y = np.moveaxis(view.places(scale * model.undistort(field)), -1, 0)
    waves = [np.sin(x / 7 + c) * np.cos(y / 9 - c) for c in range(3)]
    shown = warp.apply(image, view)[margin:-margin, margin:-margin]
    assert_allclose(shown, 0.5 + 0.4 * np.stack(waves, -1), atol=0.004)


def test_too_little_overscan_is_used_up():
    image, view = np.ones((126, 166, 3)), Viewport(width=160, height=120, left=-3, top=-3)
    warp = Warp(distortion=BARREL)
    assert warp.scale(np.ones((120, 160, 3)), Viewport(width=160, height=120)) < warp.scale(image, view) < 1
    assert_allclose(warp.apply(image, view)[3:-3, 3:-3], 1, atol=1e-12)


@pytest.mark.parametrize("model", [BARREL, PINCUSHION])
def test_a_part_of_the_picture_is_the_part_of_the_whole_over_black(model):
    """Oracle: the whole picture with black around that part."""
    whole = np.zeros((120, 160, 4))
    whole[40:70, 90:140] = RNG.random((30, 50, 4))
    view = Viewport(width=160, height=120, left=80, top=30)
    warp = Warp(distortion=model)
    part = warp.apply(whole[30:80, 80:150], view)
    assert_allclose(part, warp.apply(whole)[30:80, 80:150], atol=1e-12)


@pytest.mark.parametrize("margin", [40, 200])
def test_overscan_beyond_the_reach_of_a_model_is_black(margin):
    image = np.ones((100 + 2 * margin, 100 + 2 * margin, 3))
    view = Viewport(width=100, height=100, left=-margin, top=-margin)
    for model in (DivisionModel(strength=0.8), BrownConrady(radial=(-0.12, 0.0, 0.0))):
        result = Warp(distortion=model).apply(image, view)
        assert np.isfinite(result).all()
        assert_allclose(result[margin:-margin, margin:-margin], 1, atol=1e-9)
        if margin == 200:
            assert_array_equal(result[0, 0], 0)


@pytest.mark.parametrize(
    "make",
    [
        lambda s: Warp(distortion=DivisionModel(strength=s)),
        lambda s: Warp(distortion=DivisionModel(strength=-s)),
        lambda s: Warp(distortion=BrownConrady(radial=(s, -s, 0.0), decentring=(s, s))),
        lambda s: Warp(lateral=s),
    ],
)
def test_nothing_jumps_as_the_strength_grows(make):
    """Halving the step halves the largest change, from 0 on and across half pixels (30 px to the corner)."""
    image = RNG.random((36, 48, 3))
    for strength in (0.0, 0.004, 0.0162, 0.0333):
        before = make(strength).apply(image)
        changes = [np.abs(make(strength + step).apply(image) - before).max() for step in (1e-4, 5e-5)]
        assert 0 < changes[1] < 0.6 * changes[0] < 0.05


def test_without_effect_the_picture_is_the_picture():
    image = RNG.random((9, 11, 3))
    assert Warp().apply(image) is image
    assert Warp().undo(image) is image
    for identity in (DivisionModel(strength=0.0), BrownConrady()):
        assert_allclose(Warp(distortion=identity).apply(image), image, atol=1e-12)


@pytest.mark.parametrize("model", [BARREL, BROWN])
def test_tensors_and_batches_are_treated_as_arrays_are(model):
    images, warp = RNG.random((2, 20, 30, 3)), Warp(distortion=model, lateral=0.01)
    results = warp.apply(torch.from_numpy(images))
    for result, image in zip(results, images, strict=True):
        assert_allclose(result.numpy(), warp.apply(image), atol=1e-12)


def test_gradients_of_light_and_coefficients():
    """Oracle: finite differences, by gradcheck; the scale moves with the coefficients."""
    image = torch.from_numpy(RNG.random((6, 8, 3))).requires_grad_()  # equal pixels would be kinks

    def division(image, strength, lateral):
        return Warp(distortion=DivisionModel(strength=strength), lateral=lateral).apply(image)

    def brown(image, k1, k2, p1):
        return Warp(distortion=BrownConrady(radial=(k1, k2, 0.0), decentring=(p1, 0.0))).apply(image)

    def tensors(*numbers):
        return [torch.tensor(number, dtype=torch.float64, requires_grad=True) for number in numbers]

    assert torch.autograd.gradcheck(division, (image, *tensors(-0.21, 0.013)))
    assert torch.autograd.gradcheck(brown, (image, *tensors(-0.11, 0.032, 0.013)))


def test_a_picture_that_folds_is_reported():
    warp = Warp(distortion=BrownConrady(radial=(-0.4, 0.0, 0.0)))
    with pytest.raises(ParameterError, match=r"distortion: .* folds over itself .* got one at 0\.609; take"):
        warp.apply(np.ones((40, 60, 3)))
    with pytest.raises(ParameterError, match="folds over itself"):
        warp.check()
    for model in MODELS[:4]:
        Warp(distortion=model).check()


@pytest.mark.parametrize("lateral", [0.11, -0.2, math.nan])
def test_a_lateral_magnification_out_of_range_is_reported(lateral):
    with pytest.raises(ParameterError, match="lateral: expected"):
        dataclasses.replace(Warp(), lateral=lateral)

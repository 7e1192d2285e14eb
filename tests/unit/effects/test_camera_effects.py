"""All effects together: their order, alpha, parts of pictures, and the way back."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.effects import CameraEffects, DivisionModel, Grain, Viewport, Vignette, Warp
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.optics.vignette import cos4_factor, rim_factor

RNG = np.random.default_rng(0)
IMAGE = RNG.random((40, 60, 3), dtype=np.float32)
EVERYTHING = CameraEffects(
    distortion=DivisionModel(strength=-0.1),
    lateral=0.004,
    cos4=35,
    optical_vignetting=0.8,
    vignette=Vignette(stops=0.7, roundness=0.3),
    grain=Grain(iso=6400),
)


def test_by_default_a_picture_is_returned_as_it_is():
    assert CameraEffects().apply(IMAGE) is IMAGE
    assert CameraEffects().undo(IMAGE) is IMAGE
    assert CameraEffects(vignette=Vignette(stops=0.0)).apply(IMAGE).tobytes() == IMAGE.tobytes()


def test_the_lens_comes_first_then_its_shade_then_the_sensor():
    """Oracle: the single effects in that order, each tested by itself."""
    view = Viewport.of(IMAGE)
    field = view.field(slice(0, 40), 60, IMAGE)
    warped = Warp(distortion=EVERYTHING.distortion, lateral=0.004).apply(IMAGE)
    factor = cos4_factor(field, 35) * rim_factor(field, 0.8) * EVERYTHING.vignette.factor(field, 1.5)
    expected = EVERYTHING.grain.add(warped * factor[..., None].astype(np.float32), frame=3)
    result = EVERYTHING.apply(IMAGE, frame=3)
    assert result.dtype == np.float32
    assert_allclose(result, expected, atol=1e-6)
    assert np.abs(result - EVERYTHING.apply(IMAGE, frame=4)).max() > 0.01


def test_alpha_moves_with_green_and_is_neither_darkened_nor_grained():
    alpha = np.zeros((40, 60, 1), np.float32)
    alpha[10:30, 5:40] = 1
    layer = np.concatenate([IMAGE * alpha, alpha], -1)
    result = EVERYTHING.apply(layer)
    moved = Warp(distortion=EVERYTHING.distortion).apply(alpha)
    lens_only = Warp(distortion=EVERYTHING.distortion, lateral=0.004)
    assert_allclose(result[..., 3:], lens_only.apply(layer)[..., 3:], atol=1e-7)
    assert np.abs(moved - alpha).max() > 0
    empty = result[..., 3] == 0
    assert empty.sum() > 200
    bare = dataclasses.replace(EVERYTHING, lateral=0.0).apply(layer)
    assert_array_equal(bare[bare[..., 3] == 0], 0)


def test_shade_and_grain_of_a_part_are_those_of_the_whole():
    """Also where the part crosses the bands of rows in which the whole is made."""
    effects = dataclasses.replace(EVERYTHING, distortion=None, lateral=0.0)
    image = RNG.random((300, 30, 3), dtype=np.float32)
    part = effects.apply(image[241:290, 11:25], view=Viewport(width=30, height=300, left=11, top=241))
    assert_array_equal(part, effects.apply(image)[241:290, 11:25])


def test_shade_is_undone_to_rounding():
    effects = CameraEffects(cos4=60, optical_vignetting=1.5, vignette=Vignette(stops=4.0))
    dark = effects.apply(IMAGE)
    assert dark[0, 0].max() < 0.01
    assert_allclose(effects.undo(dark), IMAGE, rtol=1e-6)


def test_the_lens_is_undone_after_its_shade():
    rows, columns = np.mgrid[:80, :100]
    image = (0.5 + 0.3 * np.sin(columns / 8) * np.cos(rows / 11))[..., None].repeat(3, -1)
    effects = dataclasses.replace(EVERYTHING, grain=None)
    error = np.abs(effects.undo(effects.apply(image)) - image)[20:60, 25:75]
    assert error.max() < 0.01


def test_grain_cannot_be_undone():
    with pytest.raises(ParameterError, match="grain: expected None, because grain cannot be undone"):
        EVERYTHING.undo(IMAGE)


@pytest.mark.parametrize("name", ["cos4", "optical_vignetting"])
def test_shade_grows_steadily_from_nothing(name):
    """Halving a strength lessens its change, down to nothing."""
    changes = [
        np.abs(CameraEffects(**{name: strength}).apply(IMAGE.astype(float)) - IMAGE).max()
        for strength in (1.0, 0.5, 0.25, 1e-6)
    ]
    assert changes[0] > changes[1] > changes[2] > 0
    assert changes[3] < 1e-6


def test_gradients_through_everything():
    """Oracle: finite differences, by gradcheck."""
    image = torch.from_numpy(RNG.random((4, 5, 3))).requires_grad_()
    angle = torch.tensor(30.0, dtype=torch.float64, requires_grad=True)
    shift = torch.tensor(0.7, dtype=torch.float64, requires_grad=True)

    def take(image, angle, shift):
        return dataclasses.replace(EVERYTHING, cos4=angle, optical_vignetting=shift).apply(image)

    assert torch.autograd.gradcheck(take, (image, angle, shift))
    plain = dataclasses.replace(EVERYTHING, cos4=30, optical_vignetting=0.7)
    assert_allclose(
        take(image, angle, shift).detach().numpy(), plain.apply(image.detach().numpy()), atol=1e-12
    )


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"cos4": 81}, "cos4: expected 0 to 80, got 81"),
        ({"cos4": math.nan}, "cos4"),
        ({"optical_vignetting": -0.1}, "optical_vignetting: expected 0 to 1.5"),
        ({"lateral": 1.0}, "lateral: expected -0.1 to 0.1"),
    ],
)
def test_a_number_out_of_range_is_reported(numbers, message):
    with pytest.raises(ParameterError, match=message):
        CameraEffects(**numbers)


def test_a_file_that_is_not_a_picture_is_reported():
    with pytest.raises(ShapeError, match=r"expected shape \(..., H, W, 3\)"):
        EVERYTHING.apply(IMAGE[..., 0])
    with pytest.raises(ShapeError, match="no empty side"):
        EVERYTHING.apply(IMAGE[:0])
    with pytest.raises(ParameterError, match="NaN or infinite"):
        EVERYTHING.apply(np.full((4, 4, 3), np.nan))
    with pytest.raises(ParameterError, match="expected scene-linear floats, got uint8"):
        EVERYTHING.apply(np.zeros((4, 4, 3), np.uint8))


@pytest.mark.parametrize("kind", ["numpy", "torch"])
def test_colour_that_a_vignette_takes_comes_back_and_alpha_stays(kind):
    vignette = Vignette(stops=0.5, color_loss=0.8)
    effects = CameraEffects(vignette=vignette)
    layer = np.concatenate([IMAGE, np.full((40, 60, 1), 0.5, np.float32)], -1)
    original = layer if kind == "numpy" else torch.from_numpy(layer)
    result = effects.apply(original)
    assert_array_equal(np.asarray(result)[..., 3], 0.5)
    corner, middle = np.asarray(result)[0, 0, :3], np.asarray(result)[20, 30, :3]
    assert_allclose(middle, IMAGE[20, 30])
    expected = 0.2126 * IMAGE[0, 0, 0] + 0.7152 * IMAGE[0, 0, 1] + 0.0722 * IMAGE[0, 0, 2]
    darker = vignette.factor(Viewport.of(IMAGE).field(slice(0, 1), 60, IMAGE), 1.5)[0, 0]
    left = 1 - 0.8 * np.log2(darker) / -0.5  # the factor is 2^(-stops m)
    assert_allclose(corner, darker * (expected + left * (IMAGE[0, 0] - expected)), rtol=1e-4)
    assert_allclose(np.asarray(effects.undo(result)), layer, atol=1e-5)


def test_a_grey_corner_stays_grey_when_undone():
    effects = CameraEffects(vignette=Vignette(stops=0.0, color_loss=1.0, radius=0.0, softness=0.05))
    result = effects.undo(effects.apply(IMAGE))
    assert_allclose(result[0, 0], result[0, 0, 0], rtol=1e-5)
    assert np.isfinite(result).all()

"""Directions and reflectances of surfaces."""

import numpy as np
import pytest
import torch

from bokehnet.errors import ParameterError, ShapeError
from bokehnet.raytrace.frames import cosine_directions, from_frame, to_frame
from bokehnet.raytrace.ggx import ggx_reflectance, sample_ggx
from bokehnet.raytrace.lights import Environment
from bokehnet.raytrace.materials import Material
from bokehnet.raytrace.space import dot, unit

COUNT = 200000


def squares(count=COUNT, seed=0):
    return torch.rand(count, 2, generator=torch.Generator().manual_seed(seed))


def directions(count, seed=0):
    return unit(torch.randn(count, 3, generator=torch.Generator().manual_seed(seed)))


def test_frames_keep_lengths_and_turn_back():
    axis, vectors = directions(100), directions(100, 1)
    axis[0], axis[1] = torch.tensor([0.0, 0.0, 1.0]), torch.tensor([0.0, 0.0, -1.0])
    turned = from_frame(axis, vectors)
    assert torch.allclose(turned.norm(dim=-1), torch.ones(100), atol=1e-5)
    assert torch.allclose(dot(turned, axis), vectors[:, 2], atol=1e-5)
    assert torch.allclose(to_frame(axis, turned), vectors, atol=1e-5)


def test_cosine_directions_have_the_moments_of_a_cosine():
    """Authority: with density cos / pi, E[cos] = 2/3, E[cos^2] = 1/2, and sideways nothing."""
    normal = directions(1).expand(COUNT, 3)
    drawn = cosine_directions(normal, squares())
    cosine = dot(drawn, normal)
    assert float(cosine.min()) >= -1e-6
    assert float(cosine.mean()) == pytest.approx(2 / 3, abs=3e-3)
    assert float((cosine**2).mean()) == pytest.approx(1 / 2, abs=3e-3)
    assert float((drawn.mean(0) - normal[0] * 2 / 3).norm()) < 5e-3


@pytest.mark.parametrize("tilt", [0.0, 0.9, 1.4])
@pytest.mark.parametrize("roughness", [0.15, 0.5, 1.0])
def test_drawn_gloss_has_the_integral_and_the_mean_direction_of_its_reflectance(tilt, roughness):
    """Oracle: reflectance * cosine over the half sphere by even directions."""
    normal = torch.tensor([[0.0, 0.0, 1.0]]).expand(COUNT, 3)
    view = torch.tensor([[np.sin(tilt), 0, np.cos(tilt)]], dtype=torch.float32).expand(COUNT, 3)
    rough = torch.full((COUNT,), roughness)
    drawn, factor = sample_ggx(view, normal, rough, squares())
    even = directions(COUNT, 5)
    even[:, 2] = even[:, 2].abs()
    weight = 2 * np.pi * ggx_reflectance(view, even, normal, rough) * even[:, 2]
    assert float(factor.mean()) == pytest.approx(float(weight.mean()), rel=0.04)
    assert float(factor.max()) <= 1
    for axis in (0, 2):
        first, second = (float((w * d[:, axis]).mean()) for w, d in ((factor, drawn), (weight, even)))
        assert first == pytest.approx(second, abs=0.03)


def test_a_smooth_surface_reflects_like_a_mirror():
    view = unit(torch.tensor([[0.3, -0.2, 0.9]])).expand(1000, 3)
    normal = torch.tensor([[0.0, 0.0, 1.0]]).expand(1000, 3)
    drawn, factor = sample_ggx(view, normal, torch.full((1000,), 0.001), squares(1000))
    error = (drawn - view * torch.tensor([-1.0, -1.0, 1.0])).norm(dim=-1)
    assert float(error.quantile(0.95)) < 0.02
    assert float(factor.min()) > 0.999


def test_environment_maps_the_middle_ahead_and_the_first_row_up():
    """Authority: longitude and latitude as documented; the seam behind the camera is continuous."""
    texture = torch.zeros(3, 5, 8)
    texture[0] = torch.arange(8.0)
    texture[1] = torch.arange(5.0)[:, None]
    sky = Environment(texture=texture)
    seen = sky.texture_lookup(
        torch.tensor([[0.0, 0.0, 3.0], [2.0, 0, 0], [-1.0, 0, 0], [0, -1.0, 0], [0, 5.0, 0]])
    )
    assert seen[:3, 0].tolist() == pytest.approx([3.5, 5.5, 1.5])
    assert seen[:, 1].tolist() == pytest.approx([2, 2, 2, 0, 4], abs=1e-4)
    left, right = sky.texture_lookup(torch.tensor([[-1e-4, 0.0, -1.0], [1e-4, 0.0, -1.0]]))[:, 0].tolist()
    assert left == pytest.approx(right, abs=1e-2)


def test_materials_that_make_light_are_refused():
    with pytest.raises(ParameterError, match=r"sum of at most 1, got 1\.1"):
        Material(color=(0.6, 0.6, 0.6), specular=(0.5, 0.4, 0.4))
    with pytest.raises(ParameterError, match="emission"):
        Material(emission=(-1.0, 0.0, 0.0))
    with pytest.raises(ParameterError, match=r"roughness: expected 0\.001 to 1, got 0"):
        Material(roughness=0.0)
    with pytest.raises(ShapeError, match=r"\(4, Ht, Wt\)"):
        Material(texture=torch.ones(3, 2, 2))
    with pytest.raises(ShapeError, match=r"\(3, Ht, Wt\)"):
        Environment(texture=torch.ones(4, 2, 2))

"""Accumulation, tiles, samples by variance."""

import itertools

import numpy as np
import pytest
import torch

from bokehnet.errors import ParameterError
from bokehnet.optics.pixels.sample_allocation import neyman
from bokehnet.raytrace.adaptive import advance_adaptive
from bokehnet.raytrace.geometry.quads import Quad
from bokehnet.raytrace.geometry.spheres import Sphere
from bokehnet.raytrace.surfaces.materials import Material
from bokehnet.raytrace.tracer import Accumulation, Tracer
from bokehnet.raytrace.world import Body, World

from .test_integrator import camera


def wall_and_ball():
    """A bright ball, far out of focus, before a dim wall in focus."""
    wall = Body(
        shape=Quad(centre=(0, 0, 1500), u_axis=(2000, 0, 0), v_axis=(0, 2000, 0)),
        material=Material(emission=(0.2, 0.2, 0.2)),
    )
    ball = Body(shape=Sphere(centre=(0, 0, 600), radius=40), material=Material(emission=(0.9, 0.7, 0.5)))
    return World(bodies=(ball, wall))


@pytest.mark.parametrize("seed", range(4))
def test_samples_are_spread_so_that_no_other_way_leaves_less_variance(seed):
    """Oracle: all ways to give out a budget among four pixels."""
    rng = np.random.default_rng(seed)
    variance, sent, budget = rng.random(4) ** 3, rng.integers(1, 4, 4), 9
    more = neyman(variance, sent, budget)
    assert more.sum() == budget
    ways = [way for way in itertools.product(range(budget + 1), repeat=4) if sum(way) == budget]
    least = min(float((variance / (sent + way)).sum()) for way in ways)
    # Whole samples that carry their parts over lie within one sample of the best way.
    assert float((variance / (sent + more)).sum()) <= 1.08 * least


def test_many_samples_follow_the_root_of_the_variance():
    """Authority: Neyman, 1934."""
    variance = np.random.default_rng(0).random(1000)
    more = neyman(variance, np.zeros(1000), 10**6)
    assert more.sum() == 10**6
    expected = 10**6 * np.sqrt(variance) / np.sqrt(variance).sum()
    assert np.abs(more - expected).max() <= 1.01
    assert not neyman(np.zeros(3), np.ones(3), 100).any()


@pytest.mark.parametrize("method", ["distribution", "accumulation"])
def test_rows_are_those_of_the_whole_picture(method):
    view = camera(f_number=2.0)
    whole = Tracer(wall_and_ball(), view, method=method, seed=5).render(8)
    for rows in ((0, 5), (5, 6), (6, view.height)):
        part = Tracer(wall_and_ball(), view, method=method, seed=5, rows=rows).render(8)
        assert torch.equal(part.bokeh, whole.bokeh[slice(*rows)])
        assert torch.equal(part.coverage, whole.coverage[slice(*rows)])
    with pytest.raises(ParameterError, match="rows"):
        Tracer(wall_and_ball(), view, rows=(3, 3))


def test_all_pixels_of_a_view_share_their_point_of_the_pupil():
    """Authority: a pinhole picture of things that shine has no noise: in focus nothing moves."""
    view = camera(f_number=2.0, focus_distance=1500.0)
    texture = torch.rand(4, 9, 9, generator=torch.Generator().manual_seed(1))
    texture[3] = 1
    wall = Body(
        shape=Quad(centre=(0, 0, 1500), u_axis=(900, 0, 0), v_axis=(0, 700, 0)),
        material=Material(emission=(1.0, 1.0, 1.0), texture=texture),
    )
    tracer = Tracer(World(bodies=(wall,)), view, method="accumulation")
    film = tracer.render(3)
    assert torch.allclose(film.bokeh, film.all_in_focus, atol=1e-4)
    with pytest.raises(ParameterError, match="method"):
        Tracer(World(), view, method="views")


def test_variance_is_that_of_the_samples_and_noise_is_less_where_samples_go():
    view = camera(f_number=2.0)
    tracer = Tracer(wall_and_ball(), view, bounces=0)
    film = advance_adaptive(tracer, tracer.begin())
    everywhere = torch.arange(view.width * view.height)
    ((_, result),) = tracer.trace(everywhere, 0, 16)
    light = result[..., :3] @ result.new_tensor([0.2126, 0.7152, 0.0722])
    assert torch.allclose(film.variance.flatten(), light.var(0, unbiased=False), atol=1e-5)
    assert torch.allclose(film.bokeh.reshape(-1, 3), result[..., :3].mean(0), atol=1e-5)
    assert film.samples == 16
    while film.samples < 64:
        film = advance_adaptive(tracer, film)
    assert film.counts.float().mean() == pytest.approx(64, abs=1)
    assert film.counts.min() >= 16
    truth = tracer.render(2048).bokeh
    even = tracer.render(64).bokeh
    errors = [float((picture - truth).square().mean()) for picture in (film.bokeh, even)]
    assert errors[0] < 0.6 * errors[1]


def test_samples_of_one_pixel_do_not_depend_on_where_a_picture_was_broken_off():
    view = camera(f_number=2.0)
    tracer = Tracer(wall_and_ball(), view, bounces=0)
    film = advance_adaptive(tracer, advance_adaptive(tracer, tracer.begin()))
    copy = Accumulation.from_stacked(film.stacked(), film.samples, film.counts, film.variance)
    first, second = (advance_adaptive(tracer, part) for part in (film, copy))
    assert torch.equal(first.bokeh, second.bokeh)
    assert torch.equal(first.counts, second.counts)


def test_many_views_are_the_distributed_picture():
    """Authority: the distribution tracer, whose pixels share nothing; 45 dB at 1024 views."""
    view = camera(f_number=2.0)
    pictures = [
        Tracer(wall_and_ball(), view, bounces=0, method=method, seed=seed).render(samples).bokeh
        for method, seed, samples in (("accumulation", 1, 1024), ("distribution", 2, 2048))
    ]
    assert float((pictures[0] - pictures[1]).square().mean()) < 10**-4.5

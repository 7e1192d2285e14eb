"""Bundles of rays in place of each pixel's own. Oracle: rays of the aberration map through a plane."""

import math

import numpy as np
import pytest

import bokehnet.classical.rays_renderer
from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.layered.march.aberrated_rays import lens_table
from bokehnet.classical.layered.march.bundle_extents import bundle_extents
from bokehnet.classical.layered.march.defocus_bins import occupied_bins
from bokehnet.classical.layered.march.intersection import layer_cells
from bokehnet.classical.layered.march.ray_marching import RaysJob
from bokehnet.classical.layered.march.smooth_tiles import render_smooth_tiles
from bokehnet.classical.rays_renderer import pupil_pattern, rays
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.sampling import disc_from_square, sobol
from tests.unit.classical.aberrated_lenses import GLASS

HEIGHT, WIDTH, TOP, LEFT = 240, 320, 104, 152

LENSES = {
    "sliders": LensResponse(aberration_map=GLASS),
    "fringes": LensResponse(chromatic_aberration=ChromaticAberration(axial=1.0, lateral=1.0)),
    "rim and tilt": LensResponse(
        aberration_map=AberrationMap(
            wavelengths=GLASS.wavelengths,
            transverse_aberration=GLASS.transverse_aberration,
            pupil_aberration=GLASS.pupil_aberration,
            vignetting_apertures=((0.9, 1.0),),
            tilt=(0.1, -0.05),
        )
    ),
}


def picture() -> np.ndarray:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    waves = [np.sin(0.41 * x + 0.1 * c * y) + np.cos(0.37 * y - 0.13 * (c + 1) * x) for c in range(3)]
    return (0.5 + 0.2 * np.stack(waves, -1)).astype(np.float32)


def plane(middle: float, right: float = 0.01, down: float = -0.006) -> np.ndarray:
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    return (middle + right * (x - LEFT) + down * (y - TOP)).astype(np.float32)


def one_layer(image: np.ndarray, defocus: np.ndarray) -> Layers:
    coverage = np.ones((*defocus.shape, 1), np.float32)
    return Layers(colors=image[:, :, None], defocus=defocus[..., None], coverage=coverage)


def rendered(layers: Layers, lens_response: LensResponse, **how) -> tuple[np.ndarray, np.ndarray]:
    """The picture, NaN where nothing was written, and the pixels that are left."""
    shape = layers.defocus.shape[:2]
    points, weights, chances = pupil_pattern(Aperture())
    lens = lens_table(lens_response, Viewport.whole(*shape), chances, shape=shape)
    result = np.full((*shape, 3), np.nan, np.float32)
    colors = np.ascontiguousarray(layers.colors, np.float32)
    near = np.zeros(shape, np.float32)
    job = rays_job(colors, layer_cells(layers), points, weights, lens, **how)
    left = render_smooth_tiles(job, near, bundle_extents(points, lens), result)
    return result, left > 0


def rays_job(colors, cells, points, weights, lens, **how) -> RaysJob:
    """The job of a picture whose pixels are all rendered."""
    bins = occupied_bins(cells)
    rays_mask = np.ones(cells.shape[:2], bool)
    return RaysJob(
        colors=colors,
        cells=cells,
        rays_mask=rays_mask,
        bins=bins,
        points=points,
        weights=weights,
        radius=0,
        nominal_rays=1,
        lens=lens,
        **how,
    )


def seen(image, defocus_of, slopes, lens_response, y, x, count=4096):
    """Return the light of a plane in one pixel by nearest pixels, ray by ray."""
    chances = sobol(count, np.random.default_rng(9), 5)
    wavelengths, colors = lens_response.sample_wavelengths(count)
    half_diagonal = 0.5 * math.hypot(WIDTH, HEIGHT)
    field = np.array([x - 0.5 * (WIDTH - 1), y - 0.5 * (HEIGHT - 1)]) / half_diagonal
    total, weight = np.zeros(3), np.zeros(3)
    order = np.random.default_rng(4).permutation(count)
    for a, start, i in zip(disc_from_square(chances[:, :2]), chances[:, 2:4] - 0.5, order, strict=True):
        missed, run, passes = lens_response.aberration_map(a, field, wavelengths[i])
        if lens_response.chromatic_aberration is not None:
            axial, lateral = lens_response.chromatic_aberration.strengths(wavelengths[i : i + 1])[0]
            maps = lens_response.chromatic_aberration.maps(field)
            missed = missed + axial * maps[0] * a + lateral * maps[1] * field
        missed = half_diagonal * missed
        depth = (defocus_of[y, x] - slopes @ missed) / (1 + slopes @ run)
        way = start - missed - depth * run
        share = passes * colors[i]
        total += share * image[round(y + way[1]), round(x + way[0])]
        weight += share
    return total / weight


@pytest.mark.parametrize(
    ("name", "middle"),
    [
        ("sliders", -9.0),
        ("sliders", 9.0),
        ("fringes", 9.0),
        ("rim and tilt", 0.0),
        pytest.param("sliders", 0.0, marks=pytest.mark.slow),
        pytest.param("fringes", -9.0, marks=pytest.mark.slow),
        pytest.param("fringes", 0.0, marks=pytest.mark.slow),
        pytest.param("rim and tilt", -9.0, marks=pytest.mark.slow),
        pytest.param("rim and tilt", 9.0, marks=pytest.mark.slow),
    ],
)
def test_pixels_of_a_tile_see_a_leaning_plane_as_their_own_rays_do(name, middle):
    image, defocus = picture(), plane(middle)
    result, left = rendered(one_layer(image, defocus), LENSES[name])
    places = [(TOP + 3, LEFT + 4), (TOP, LEFT), (TOP + 7, LEFT + 7), (TOP - 24, LEFT + 45)]
    for y, x in places:
        assert not left[y, x]
        expected = seen(image, defocus, np.array([0.01, -0.006]), LENSES[name], y, x)
        np.testing.assert_allclose(result[y, x], expected, atol=0.012)


def test_pictures_are_those_of_each_pixels_rays(monkeypatch):
    """A leaning ground and a post: alike within the noise, and alike in the mean."""
    image, defocus = picture() ** 2, plane(-6.0, 0.02, -0.02)
    defocus[60:180, 200:220] = 5.0
    lens_response = LensResponse(
        aberration_map=GLASS, chromatic_aberration=ChromaticAberration(axial=0.5, lateral=0.5)
    )
    actual = rays(image, defocus, lens_response=lens_response)
    shares = []

    def leave_all(job, near, extents, result):
        left = render_smooth_tiles(job, near, extents, result.copy())
        shares.append(1 - (left > 0).mean())
        return np.ones_like(near)

    monkeypatch.setattr(bokehnet.classical.rays_renderer, "render_smooth_tiles", leave_all)
    seeds = [rays(image, defocus, lens_response=lens_response, seed=seed) for seed in range(4)]
    assert 0.2 < shares[0] < 0.95
    expected = np.mean(seeds, axis=0)
    assert -10 * np.log10(np.mean((actual - expected) ** 2)) > 45
    assert abs(actual.mean() / expected.mean() - 1) < 5e-4


def test_white_stays_white():
    image = np.full((HEIGHT, WIDTH, 3), 0.7, np.float32)
    for lens_response in LENSES.values():
        result, left = rendered(one_layer(image, plane(5.0)), lens_response)
        np.testing.assert_allclose(result[~left], 0.7, rtol=1e-5)


def test_tiles_with_a_step_something_hidden_or_a_steep_ground_are_left():
    image, lens_response = picture(), LENSES["sliders"]
    assert not rendered(one_layer(image, plane(3.0)), lens_response)[1].any()
    stepped = plane(3.0)
    stepped[TOP, LEFT + 2] += 20
    hidden, partly = (one_layer(image, plane(3.0)) for _ in range(2))
    hidden = Layers(
        colors=np.repeat(hidden.colors, 2, axis=2),
        defocus=np.repeat(hidden.defocus, 2, axis=2),
        coverage=np.repeat(hidden.coverage, 2, axis=2),
    )
    hidden.defocus[TOP, LEFT + 2, 1] = -9
    partly.coverage[TOP, LEFT + 2] = 0.5
    scenes = [one_layer(image, stepped), hidden, partly, one_layer(image, plane(3.0, right=0.2))]
    for layers in scenes:
        assert rendered(layers, lens_response)[1][TOP, LEFT]


def test_curved_ground_and_the_border_are_seen_as_each_pixels_rays_see_them(monkeypatch):
    """A wavy ground over all of the picture; the mean of seeds is of the rays of each pixel."""
    image = picture()
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    defocus = (-8 + 3 * np.sin(x / 25) + 2 * np.cos(y / 30)).astype(np.float32)
    actual = rays(image, defocus, lens_response=LENSES["sliders"])

    def leave_all(job, near, extents, result):
        return np.ones_like(near)

    monkeypatch.setattr(bokehnet.classical.rays_renderer, "render_smooth_tiles", leave_all)
    seeds = [rays(image, defocus, lens_response=LENSES["sliders"], seed=seed) for seed in range(4)]
    expected = np.mean(seeds, axis=0)
    border = np.ones((HEIGHT, WIDTH), bool)
    border[16:-16, 16:-16] = False
    for part in (border, ~border):
        assert -10 * np.log10(np.mean((actual - expected)[part] ** 2)) > 45


def test_a_strip_gives_the_rows_of_the_picture():
    image, defocus = picture(), plane(-7.0)
    for name in ("sliders", "rim and tilt"):
        whole, _ = rendered(one_layer(image, defocus), LENSES[name])
        viewport = Viewport.whole(HEIGHT, WIDTH)
        points, weights, chances = pupil_pattern(Aperture())
        lens = lens_table(LENSES[name], viewport, chances, above=64, shape=(HEIGHT - 64, WIDTH))
        result = np.full((HEIGHT - 64, WIDTH, 3), np.nan, np.float32)
        layers = one_layer(image[64:], defocus[64:])
        near = np.zeros(result.shape[:2], np.float32)
        colors = np.ascontiguousarray(layers.colors)
        job = rays_job(colors, layer_cells(layers), points, weights, lens, above=64, viewport=viewport)
        left = render_smooth_tiles(job, near, bundle_extents(points, lens), result)
        below = np.s_[64:]  # what the strip's first row cuts off is far above
        assert (left == 0).all()
        np.testing.assert_array_equal(result[below], whole[64:][below])

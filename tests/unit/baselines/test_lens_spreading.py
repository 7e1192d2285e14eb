"""Spreading with the tables of a lens, against the rays of the same lens."""

import math

import numpy as np
import pytest

from bokehnet import baselines
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ParameterError
from bokehnet.lenses import load_lens
from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.point_spread import PsfGrid, aberration_psf, correlation
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.sampling import disc_from_square, sobol

HEIGHT, WIDTH = 61, 91


@pytest.fixture(scope="module")
def lens_response():
    lens = load_lens("double_gauss", f_number=2.0, focus_distance=3000.0)
    return LensResponse(aberration_map=fit_aberration_map(lens, wavelengths=()))


@pytest.mark.parametrize("place", [(45, 30), (75, 45), (67, 22)])
@pytest.mark.parametrize("radius", [8.0, -8.0])
def test_a_point_spreads_as_the_rays_of_the_lens_do(lens_response, place, radius):
    """Authority: light sent ray by ray through the map, clipped by its rims."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    image[place[1], place[0]] = 1
    even = np.full((HEIGHT, WIDTH), radius, np.float32)
    result = baselines.lens_spreading(image, even, lens_response=lens_response)
    half, scale = 15, 2 / math.hypot(WIDTH, HEIGHT)
    field = scale * (place[0] - (WIDTH - 1) / 2), scale * (place[1] - (HEIGHT - 1) / 2)
    expected = aberration_psf(
        lens_response.aberration_map,
        PsfGrid(
            pitch=scale,
            size=2 * half + 1,
            wavelengths=lens_response.aberration_map.wavelengths,
            colors=np.ones((1, 3)),
        ),
        defocus=radius * scale,
        field=field,
    )
    window = result[place[1] - half : place[1] + half + 1, place[0] - half : place[0] + half + 1]
    assert correlation(window, expected[: window.shape[0], : window.shape[1]]) > 0.97


@pytest.mark.parametrize("radius", [6.0, -6.0])
def test_a_flat_scene_is_the_mean_over_the_pupil(lens_response, radius):
    """Authority: light of p - d A(a, h) - E(a, h) arrives at p; its mean over the pupil open there."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]

    def scene(column, row):
        return 0.5 + 0.4 * np.sin(column / 4) * np.cos(row / 5)

    image = np.repeat(scene(x, y)[..., None], 3, -1).astype(np.float32)
    even = np.full((HEIGHT, WIDTH), radius, np.float32)
    result = baselines.lens_spreading(image, even, lens_response=lens_response)[..., 0]
    pupil = disc_from_square(sobol(4096, np.random.default_rng(0)))
    half = 0.5 * math.hypot(WIDTH, HEIGHT)
    for column, row in ((45, 30), (20, 15), (70, 44), (30, 40), (66, 16)):
        field = np.array([column - (WIDTH - 1) / 2, row - (HEIGHT - 1) / 2]) / half
        at = np.broadcast_to(field, pupil.shape)
        aberration, bent, passed = lens_response.aberration_map(pupil, at, 587.56)
        place = (column, row) - radius * bent - half * aberration
        expected = (passed * scene(place[:, 0], place[:, 1])).sum() / passed.sum()
        assert result[row, column] == pytest.approx(expected, abs=0.01)


def test_a_perfect_lens_spreads_discs():
    rng = np.random.default_rng(4)
    image = rng.random((40, 50, 3)).astype(np.float32)
    defocus = np.where(rng.random((40, 50)) < 0.5, 5.0, -3.0).astype(np.float32)
    result, expected = baselines.lens_spreading(image, defocus), baselines.perimeter(image, defocus)
    assert np.abs(result - expected).mean() < 0.004


def test_engines_hand_it_the_lens_and_tables_have_a_limit(lens_response):
    image = np.random.default_rng(0).random((20, 24, 3)).astype(np.float32)
    defocus = np.full((20, 24), 4.0, np.float32)
    colours = LensResponse(chromatic_aberration=ChromaticAberration(axial=1))
    for original in (lens_response, colours):
        picture = (
            Engine("lens_spreading")
            .render(image, defocus, options=RenderOptions(lens_response=original))
            .bokeh
        )
        assert np.array_equal(picture, baselines.lens_spreading(image, defocus, lens_response=original))
        assert np.abs(picture - baselines.lens_spreading(image, defocus)).max() > 1e-3
    with pytest.raises(ParameterError, match=r"^defocus: expected blur radii of at most 64"):
        baselines.lens_spreading(image, 20 * defocus)

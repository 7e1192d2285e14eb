"""Authority: rays of the aberration map itself, sent one by one from a light to the picture."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.optics.aberrations.aberration_map import DESIGN_WAVELENGTH, AberrationMap, term
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture, transmission
from tests.unit.classical.highlights.light_scenes import decibel, draw, point

SIZE = 200
HALF_DIAGONAL = SIZE / 2**0.5
LIGHT = (128.3, 121.2, -34.0)

# Name -> place in the transverse aberration: f is a row of 0, g of 1.
_MISSES = {
    "spherical": (0, (1, 0, 0)),
    "coma": (1, (1, 0, 0)),
    "astigmatism": (1, (0, 1, 0)),
    "curvature": (0, (0, 0, 1)),
}


def lens(
    *,
    wavelengths=(DESIGN_WAVELENGTH,),
    spread=0.0,
    vignetting_apertures=(),
    tilt=(0.0, 0.0),
    **transverse_aberrations,
):
    """A lens whose misses are given in pixels at the rim of the pupil and in the picture's corner."""
    transverse_aberration = np.zeros((len(wavelengths), 2, 20))
    for name, pixels in transverse_aberrations.items():
        row, powers = _MISSES[name]
        transverse_aberration[:, row, term(*powers)] = pixels / HALF_DIAGONAL
    transverse_aberration[:, :, 0] += np.linspace(-spread, spread, len(wavelengths))[:, None] / HALF_DIAGONAL
    aberration_map = AberrationMap(
        wavelengths=np.array(wavelengths),
        transverse_aberration=transverse_aberration,
        pupil_aberration=np.zeros_like(transverse_aberration),
        vignetting_apertures=vignetting_apertures,
        tilt=tilt,
    )
    return LensResponse(aberration_map=aberration_map)


LENSES = {
    "soap bubble": lens(spherical=10.0),
    "creamy": lens(spherical=-20.0),
    "caustic": lens(spherical=20.0),
    "coma": lens(coma=25.0),
    "astigmatism": lens(astigmatism=20.0, curvature=8.0),
    "leaning focus": lens(tilt=(0.004, -0.003)),
    "vignetted": lens(vignetting_apertures=((0.6, 1.1), (-0.4, 1.0))),
    "colours": lens(wavelengths=(400.0, 550.0, 700.0), spread=9.0, coma=5.0),
}


def traced(light, aperture, lens_response, *, blocked=None):
    """Picture (SIZE, SIZE, 3) of a light from jittered rays, over the share that passes.

    ``blocked`` is the defocus of a screen that covers the places of the picture from column 100 on.
    """
    x, y, defocus = light
    rng = np.random.default_rng(0)
    colored = lens_response.aberration_map.is_dispersive or lens_response.chromatic_aberration is not None
    samples = 400 if colored else 900  # along each side of the pupil, for each wavelength
    grid = np.stack(np.meshgrid(np.arange(samples), np.arange(samples)), -1).reshape(-1, 2)
    pupil = (grid + rng.random(grid.shape)) * (2 / samples) - 1
    weight = transmission(aperture, pupil[:, 0], pupil[:, 1], 1 if defocus > 0 else -1)
    pupil, weight = pupil[weight > 0], weight[weight > 0]
    wavelengths, colors = lens_response.sample_wavelengths(25)
    if not colored:
        wavelengths, colors = wavelengths[:1], colors[:1]
    result = np.zeros((SIZE, SIZE, 3))
    for wavelength, color in zip(wavelengths, colors / colors.sum(0), strict=True):
        place = np.array([x, y]) + defocus * pupil
        for _ in range(6):
            field = (place - (SIZE - 1) / 2) / HALF_DIAGONAL
            transverse_aberration, run, passes = lens_response.aberration_map(pupil, field, wavelength)
            if lens_response.chromatic_aberration is not None:
                axial, lateral = lens_response.chromatic_aberration.strengths(np.array([wavelength]))[0]
                maps = lens_response.chromatic_aberration.maps(field)
                transverse_aberration = (
                    transverse_aberration + axial * maps[:, :1] * pupil + lateral * maps[:, 1:] * field
                )
            place = np.array([x, y]) + defocus * run + HALF_DIAGONAL * transverse_aberration
        if blocked is not None:
            passes = passes & ((place - blocked * run - HALF_DIAGONAL * transverse_aberration)[:, 0] < 99.5)
        pixel = np.floor(place + 0.5).astype(int)
        kept = passes & (pixel >= 0).all(1) & (pixel < SIZE).all(1)
        counts = np.bincount(pixel[kept, 1] * SIZE + pixel[kept, 0], weight[kept], SIZE * SIZE)
        result += (counts / weight.sum()).reshape(SIZE, SIZE, 1) * color
    if (
        lens_response.aberration_map.vignetting_apertures
    ):  # as a pixel's own rays are averaged over those that pass
        place = np.arange(0, SIZE, 10)
        field = (np.stack(np.meshgrid(place, place), -1) - (SIZE - 1) / 2) / HALF_DIAGONAL
        some = slice(None, None, len(pupil) // 4000)
        passes = lens_response.aberration_map(pupil[some], field[:, :, None])[2]
        share = (passes * weight[some]).sum(-1) / weight[some].sum()
        rows = np.stack([np.interp(np.arange(SIZE), place, row) for row in share])
        share = np.stack([np.interp(np.arange(SIZE), place, column) for column in rows.T], 1)
        result /= share[..., None]
    return result


BLADES = Aperture(blades=5, rotation=20, spherical_profile=0.4)


# One lens of each kind of aberration in the quick tests.
@pytest.mark.parametrize(
    ("name", "aperture"),
    [
        *(
            pytest.param(
                name,
                Aperture(),
                marks=pytest.mark.slow if name in ("creamy", "caustic", "leaning focus") else (),
            )
            for name in LENSES
        ),
        *(pytest.param(name, BLADES, marks=pytest.mark.slow) for name in ("coma", "vignetted", "colours")),
    ],
)
def test_psf_images_hold_the_rays_of_the_map(name, aperture):
    lens_response = LENSES[name]
    picture, expected = (
        draw(point(*LIGHT), (SIZE, SIZE), aperture, lens_response=lens_response),
        traced(LIGHT, aperture, lens_response),
    )
    assert_allclose(picture.sum((0, 1)), expected.sum((0, 1)), rtol=5e-3)
    assert np.corrcoef(picture.ravel(), expected.ravel())[0, 1] > 0.998
    assert decibel(picture, expected, 1 / (np.pi * LIGHT[2] ** 2)) > 38


@pytest.mark.parametrize("defocus", [5.0, -3.2])
def test_small_discs_are_right_too(defocus):
    light, lens_response = (100.4, 110.2, defocus), lens(spherical=4.0, coma=6.0)
    picture = draw(point(*light), (SIZE, SIZE), lens_response=lens_response)
    expected = traced(light, Aperture(), lens_response)
    assert np.corrcoef(picture.ravel(), expected.ravel())[0, 1] > 0.999


def test_fringes_part_the_colours_as_their_rays_do():
    lens_response = LensResponse(chromatic_aberration=ChromaticAberration(axial=6.0, lateral=4.0))
    picture = draw(point(*LIGHT), (SIZE, SIZE), lens_response=lens_response)
    expected = traced(LIGHT, Aperture(), lens_response)
    assert np.corrcoef(picture.ravel(), expected.ravel())[0, 1] > 0.998
    assert abs(expected[..., 0] - expected[..., 2]).max() > 0.3 * expected.max()


@pytest.mark.parametrize(
    ("name", "screen"),
    [
        ("soap bubble", 25.0),
        ("coma", 0.0),
        ("leaning focus", 0.0),
        ("colours", 25.0),
        pytest.param("soap bubble", 0.0, marks=pytest.mark.slow),
        pytest.param("coma", 25.0, marks=pytest.mark.slow),
        pytest.param("leaning focus", 25.0, marks=pytest.mark.slow),
        pytest.param("colours", 0.0, marks=pytest.mark.slow),
    ],
)
def test_a_screen_clips_the_disc_where_it_stops_rays(name, screen):
    """Rays pass the screen at ``p - s A - E``; the PSF image takes E as the mean of a pixel's rays.

    Colours part at the edge of a blurred screen by what E differs between them, which the mean leaves out.
    """
    lens_response = LENSES[name]
    front = np.full((SIZE, SIZE), -2000.0)
    front[:, 100:] = screen
    light = (112.3, 104.0, -34.0) if screen else (90.3, 104.0, -34.0)
    picture = draw(point(*light), (SIZE, SIZE), front=front, lens_response=lens_response)
    expected = traced(light, Aperture(), lens_response, blocked=screen)
    assert 0.1 < expected.sum() / 3 < 0.95
    assert_allclose(picture.sum(), expected.sum(), rtol=0.02)
    assert np.corrcoef(picture.ravel(), expected.ravel())[0, 1] > (0.98 if name == "colours" else 0.99)


@pytest.mark.parametrize("screen", [0.0, 25.0, -10.0])
def test_a_screen_clips_plain_discs_with_a_smooth_edge(screen):
    """Rays pass the screen at ``p - s a``, whatever stands before or behind the plane of focus."""
    front = np.full((SIZE, SIZE), -2000.0)
    front[:, 100:] = screen
    light = (105.3, 104.0, -40.0)
    picture = draw(point(*light), (SIZE, SIZE), front=front)
    expected = traced(light, Aperture(), LensResponse(), blocked=screen)
    level = 1 / (np.pi * 40**2)
    assert_allclose(picture.sum(), expected.sum(), rtol=0.01)
    assert decibel(picture, expected, level) > 33


def test_a_merged_light_is_the_mean_of_its_pixels():
    lens_response = LENSES["coma"]
    single = [draw(point(100 + i, 120, -34.0), (SIZE, SIZE), lens_response=lens_response) for i in range(5)]
    whole = draw(point(102, 120, -34.0, 5.0), (SIZE, SIZE), lens_response=lens_response)
    assert decibel(whole, np.mean(single, axis=0), 1 / (np.pi * 34**2)) > 38


def test_a_weak_character_is_close_to_no_effect():
    plain = draw(point(*LIGHT), (SIZE, SIZE))
    level = 1 / (np.pi * LIGHT[2] ** 2)
    faint = draw(point(*LIGHT), (SIZE, SIZE), lens_response=lens(spherical=1e-3))
    assert decibel(faint, plain, level) > 40
    steps = [
        draw(point(*LIGHT), (SIZE, SIZE), lens_response=lens(spherical=s)) for s in np.linspace(3.0, 4.0, 11)
    ]
    moved = [abs(b - a).max() / level for a, b in itertools.pairwise(steps)]
    assert max(moved) < 0.35  # an edge that moves by 0.1 pixel changes a pixel by a tenth, a rim by more


def test_what_rims_let_pass_is_as_bright_as_the_rest():
    """A wall of lights through a lens with rims is even: what a pixel loses, its share gives back."""
    lens_response = lens(vignetting_apertures=((0.7, 1.0),))
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, SIZE, 4.0), np.arange(0, SIZE, 4.0)))
    ones = np.ones_like(x)
    wall = np.column_stack([x, y, 12 * ones, ones, ones, ones, 4 * ones, 4 * ones])
    picture = draw(wall, (SIZE, SIZE), lens_response=lens_response)[20:-20, 20:-20]
    assert_allclose(picture, 1 / 16, rtol=0.03)

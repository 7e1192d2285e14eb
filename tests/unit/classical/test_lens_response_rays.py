"""Pictures through an aberrated lens. Oracle: the mean over many rays of the aberration map, one by one."""

import itertools
import math

import numpy as np
import pytest

from bokehnet.classical.rays_renderer import rays, render_rays
from bokehnet.classical.scatter_renderer import render_scatter
from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.aberration_map import AberrationMap, term
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.sampling import disc_from_square, halton

HEIGHT, WIDTH = 90, 120


def picture() -> np.ndarray:
    """Smooth waves with some fine detail, dark enough to hold no lights."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    waves = [np.sin(0.21 * x + 0.1 * c * y) + np.cos(0.17 * y - 0.13 * (c + 1) * x) for c in range(3)]
    return (0.5 + 0.2 * np.stack(waves, -1)).astype(np.float32)


def decibels(first: np.ndarray, second: np.ndarray) -> float:
    return float(-10 * np.log10(np.mean((first - second) ** 2) + 1e-12))


def aberration_map(vignetting_apertures=(), tilt=(0.0, 0.0), **terms: float) -> AberrationMap:
    transverse_aberration, pupil_aberration = np.zeros((3, 2, 20)), np.zeros((3, 2, 20))
    dispersion = np.array([1.5, 0.0, -0.7])
    transverse_aberration[:, 0, term(1, 0, 0)] = terms.get("spherical", 0)
    transverse_aberration[:, 0, term(0, 1, 0)] = 2 * terms.get("coma", 0)
    transverse_aberration[:, 1, term(1, 0, 0)] = terms.get("coma", 0)
    transverse_aberration[:, 1, term(0, 0, 0)] = terms.get("lateral", 0) * dispersion
    pupil_aberration[:, 0, term(0, 0, 1)] = terms.get("pupil_aberration", 0)
    return AberrationMap(
        wavelengths=[400.0, 587.56, 700.0],
        transverse_aberration=transverse_aberration,
        pupil_aberration=pupil_aberration,
        vignetting_apertures=vignetting_apertures,
        tilt=tilt,
    )


def seen(image, defocus, lens_response, count=750, step=3):
    """Return the light of a plane in each ``step``-th pixel by nearest pixels; the border continues."""
    starts = np.stack([halton(count, 7), halton(count, 11)], -1) - 0.5
    pupil = disc_from_square(np.stack([halton(count, 2), halton(count, 3)], -1))
    wavelengths, colors = lens_response.sample_wavelengths(count)
    half_diagonal = 0.5 * math.hypot(WIDTH, HEIGHT)
    y, x = np.mgrid[:HEIGHT:step, :WIDTH:step]
    field = np.stack([x - 0.5 * (WIDTH - 1), y - 0.5 * (HEIGHT - 1)], -1) / half_diagonal
    total, weight = np.zeros((*x.shape, 3)), np.zeros((*x.shape, 3))
    for a, start, wavelength, color in zip(pupil, starts, wavelengths, colors, strict=True):
        transverse_aberration, run, passes = lens_response.aberration_map(
            np.broadcast_to(a, field.shape), field, wavelength
        )
        if lens_response.chromatic_aberration is not None:
            axial, lateral = lens_response.chromatic_aberration.strengths(np.array([wavelength]))[0]
            maps = lens_response.chromatic_aberration.maps(field)
            transverse_aberration = (
                transverse_aberration + axial * maps[..., :1] * a + lateral * maps[..., 1:] * field
            )
        way = start - defocus * run - half_diagonal * transverse_aberration
        column = np.clip(np.rint(x + way[..., 0]), 0, WIDTH - 1)
        row = np.clip(np.rint(y + way[..., 1]), 0, HEIGHT - 1)
        share = passes[..., None] * color
        total += share * image[row.astype(int), column.astype(int)]
        weight += share
    return total / weight


CHARACTERS = {
    "spherical": LensResponse(aberration_map=aberration_map(spherical=0.06)),
    "coma": LensResponse(aberration_map=aberration_map(coma=0.08)),
    "lateral": LensResponse(aberration_map=aberration_map(lateral=0.05)),
    "pupil_aberration": LensResponse(aberration_map=aberration_map(pupil_aberration=0.5)),
    "rim": LensResponse(aberration_map=aberration_map(vignetting_apertures=((0.9, 1.0),))),
    "tilt": LensResponse(aberration_map=aberration_map(tilt=(0.3, -0.2))),
    "chromatic_aberration": LensResponse(chromatic_aberration=ChromaticAberration(axial=6.0, lateral=5.0)),
}


@pytest.mark.parametrize("name", CHARACTERS)
@pytest.mark.parametrize(
    "defocus", [pytest.param(-7.0, marks=pytest.mark.slow), pytest.param(0.0, marks=pytest.mark.slow), 7.0]
)
def test_a_plane_looks_as_its_rays_say(name, defocus):
    image, lens_response = picture(), CHARACTERS[name]
    plane = np.full((HEIGHT, WIDTH), defocus, np.float32)
    result = rays(image, plane, lens_response=lens_response)[::3, ::3]
    expected = seen(image, defocus, lens_response)
    assert decibels(result, expected) > 42
    if defocus or name not in ("pupil_aberration", "rim", "tilt"):  # which do nothing in focus
        plain = rays(image, plane)[::3, ::3]
        assert decibels(result, plain) < decibels(result, expected) - 3


def test_a_lens_without_character_changes_no_bit():
    rng = np.random.default_rng(1)
    image = rng.random((HEIGHT, WIDTH, 3)).astype(np.float32)
    defocus = np.where(np.arange(WIDTH) < 60, 9.0, -4.0) * np.ones((HEIGHT, 1))
    defocus = defocus.astype(np.float32)
    for lens_response in (
        None,
        LensResponse(),
        LensResponse(aberration_map=aberration_map()),
        LensResponse(chromatic_aberration=ChromaticAberration()),
    ):
        np.testing.assert_array_equal(rays(image, defocus, lens_response=lens_response), rays(image, defocus))


def stepped() -> np.ndarray:
    return (np.where(np.arange(WIDTH) < 60, 9.0, -4.0) * np.ones((HEIGHT, 1))).astype(np.float32)


@pytest.mark.parametrize("name", ["spherical", "coma", "tilt"])
def test_a_little_character_changes_a_picture_a_little(name):
    image, defocus = picture(), stepped()
    plain = rays(image, defocus)
    changes = []
    for strength in (1e-4, 1e-3, 1e-2):
        chosen = {name: 0.1 * strength} if name != "tilt" else {"tilt": (strength, 0.0)}
        result = rays(image, defocus, lens_response=LensResponse(aberration_map=aberration_map(**chosen)))
        changes.append(np.abs(result - plain).mean())
    assert 0 < changes[0] < changes[1] < changes[2]
    assert changes[0] < 1e-4  # the noise of rays of a few pixels more


def test_colours_part_without_a_jump():
    image, defocus = picture(), stepped()
    results = [
        rays(image, defocus, lens_response=LensResponse(aberration_map=aberration_map(lateral=strength)))
        for strength in (0.0, 1e-5, 0.02, 0.0201)
    ]
    changes = [np.abs(second - first).mean() for first, second in itertools.pairwise(results)]
    assert changes[0] < 0.001  # the noise of other, and more, rays
    assert changes[2] < 0.001 < 0.005 < changes[1]


def test_the_estimate_is_independent_of_unmixed_colours():
    image, defocus = picture(), stepped()
    one, unmixed = (
        render_rays(
            image, defocus, lens_response=LensResponse(aberration_map=aberration_map(**terms))
        ).disocclusion_weight
        for terms in ({"coma": 1e-3}, {"coma": 1e-3, "lateral": 1e-3})
    )
    assert one.max() > 0.4
    # Rows of five are nearly alike: their means hold less of the noise of the rays.
    unmixed, one = (share.reshape(-1, 5, WIDTH).mean(1) for share in (unmixed, one))
    np.testing.assert_allclose(unmixed, one, atol=0.05)


def test_white_stays_white_behind_a_lens_that_parts_colours():
    image = np.full((HEIGHT, WIDTH, 3), 0.7, np.float32)
    defocus = np.full((HEIGHT, WIDTH), 6.0, np.float32)
    lens_response = LensResponse(chromatic_aberration=ChromaticAberration(axial=6.0, lateral=5.0))
    result = rays(image, defocus, aperture=Aperture(blades=6), lens_response=lens_response)
    np.testing.assert_allclose(result, image, atol=1e-6)


def test_the_scatter_reports_that_it_ignores_aberrations():
    image, defocus = picture(), stepped()
    with pytest.raises(ParameterError, match=r"engine: .* use the engine `rays`"):
        render_scatter(image, defocus, lens_response=CHARACTERS["coma"])
    leaning = render_scatter(image, defocus, lens_response=CHARACTERS["tilt"])
    np.testing.assert_array_equal(leaning.bokeh, render_scatter(image, defocus).bokeh)


def test_half_a_pixel_of_shift_is_half_a_pixel():
    ramp = np.arange(WIDTH, dtype=np.float32) / WIDTH
    image, defocus = np.tile(ramp[None, :, None], (HEIGHT, 1, 3)), np.zeros((HEIGHT, WIDTH), np.float32)
    half_diagonal, column = 0.5 * math.hypot(WIDTH, HEIGHT), 100
    field = (column - 0.5 * (WIDTH - 1)) / half_diagonal
    shifts, results = [0.75, 1.0, 1.2, 1.5, 1.9, 2.0], []
    for shift in shifts:  # to the right, at this column
        transverse_aberration = np.zeros((1, 2, 20))
        transverse_aberration[0, 1, 0] = shift / (half_diagonal * field)
        lens = LensResponse(
            aberration_map=AberrationMap(
                wavelengths=[550.0],
                transverse_aberration=transverse_aberration,
                pupil_aberration=0 * transverse_aberration,
            )
        )
        seen_there = rays(image, defocus, lens_response=lens)[10:-10, column, 0]  # alike but for the noise
        results.append(column - WIDTH * seen_there.mean())
    np.testing.assert_allclose(results, shifts, atol=0.04)

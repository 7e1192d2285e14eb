"""Eight rays of a lens at once. Oracle: its aberration map, one ray at a time, in float64."""

import math

import numpy as np
import pytest
from numba import njit

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.layered.march.aberrated_rays import collapse, lens_table, send_rays
from bokehnet.classical.simd.float8 import LANES, load8, store8
from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.aberration_map import TERMS, UNTILTED_AXES, AberrationMap
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.sampling import sobol
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH

WIDTH, HEIGHT = 400, 300
CHANCES = sobol(64, np.random.default_rng(0), 3)


@njit
def send_eight(coefficients, tilt, u, v, h_x, h_y, waves):
    collapsed = np.empty(coefficients.shape[1:], np.float32)
    collapse(coefficients, h_x * h_x + h_y * h_y, collapsed)
    result = np.empty(4 * LANES, np.float32)
    sent = send_rays(collapsed, tilt, load8(u, 0), load8(v, 0), h_x, h_y, load8(waves, 0))
    store8(result, 0, sent[0])
    store8(result, LANES, sent[1])
    store8(result, 2 * LANES, sent[2])
    store8(result, 3 * LANES, sent[3])
    return result


def random_pencil(rng: np.random.Generator, *, pupil_aberration: bool, dispersive: bool) -> AberrationMap:
    """All terms, and wavelengths on a parabola over 1 / wavelength^2."""
    wavelengths = np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, 120) if dispersive else np.array([550.0])
    variable = (wavelengths / 550) ** -2 - 1
    powers = variable[:, None] ** np.arange(3) if dispersive else np.ones((1, 1))
    shape = (powers.shape[1], 2 * len(TERMS))
    transverse_aberration, bent = (powers @ rng.uniform(-0.02, 0.02, shape) for _ in range(2))
    return AberrationMap(
        wavelengths=wavelengths,
        transverse_aberration=transverse_aberration.reshape(-1, 2, len(TERMS)),
        pupil_aberration=bent.reshape(-1, 2, len(TERMS)) * pupil_aberration,
        tilt=(0.2, -0.3) if pupil_aberration else (0.0, 0.0),
        aperture_axes=((0.9, 0.0), (0.1, 0.8), (-0.2, 0.15)) if pupil_aberration else UNTILTED_AXES,
    )


@pytest.mark.slow
@pytest.mark.parametrize("pupil_aberration", [False, True])
@pytest.mark.parametrize("dispersive", [False, True])
def test_eight_rays_go_where_the_map_sends_each(pupil_aberration, dispersive):
    rng = np.random.default_rng(5)
    lens_response = LensResponse(
        aberration_map=random_pencil(rng, pupil_aberration=pupil_aberration, dispersive=dispersive)
    )
    table = lens_table(lens_response, Viewport.whole(HEIGHT, WIDTH), CHANCES)
    wavelengths, colors = lens_response.wavelengths_at(CHANCES[:, 0])
    assert table.coefficients.shape[1:3] == (3 if dispersive else 1, 4 if pupil_aberration else 2)
    assert table.colors.shape == (3, 64 if dispersive else 0)
    if dispersive:
        np.testing.assert_allclose(table.colors, colors.T, rtol=1e-6)
    half_diagonal = 0.5 * math.hypot(WIDTH, HEIGHT)
    for start in range(0, 64, LANES):
        pupil = rng.uniform(-0.7, 0.7, (LANES, 2)).astype(np.float32)
        field = rng.uniform(-0.7, 0.7, 2).astype(np.float32)
        waves = table.waves[start : start + LANES].copy()
        u, v = np.ascontiguousarray(pupil.T)
        result = send_eight(table.coefficients, table.tilt, u, v, *field, waves).reshape(4, LANES)
        for lane in range(LANES):
            wavelength = wavelengths[start + lane]
            transverse_aberration, run, _ = lens_response.aberration_map(
                pupil[lane].astype(float), field.astype(float), wavelength
            )
            np.testing.assert_allclose(result[:2, lane], half_diagonal * transverse_aberration, atol=2e-3)
            np.testing.assert_allclose(result[2:, lane], run, atol=2e-5)


@pytest.mark.slow
def test_bounds_hold_for_every_ray():
    rng = np.random.default_rng(6)
    aberration_map = random_pencil(rng, pupil_aberration=True, dispersive=True)
    lens_response = LensResponse(
        aberration_map=aberration_map, chromatic_aberration=ChromaticAberration(axial=2.0, lateral=-3.0)
    )
    table = lens_table(lens_response, Viewport.whole(HEIGHT, WIDTH), CHANCES)
    half_diagonal = 0.5 * math.hypot(WIDTH, HEIGHT)
    stretch, reach = table.footprint
    for _ in range(300):
        angle, turn = rng.uniform(0, 2 * math.pi, 2)
        pupil = rng.random() ** 0.5 * np.array([math.cos(angle), math.sin(angle)])
        field = rng.random() * np.array([math.cos(turn), math.sin(turn)])
        wavelength = rng.uniform(MIN_WAVELENGTH, MAX_WAVELENGTH)
        transverse_aberration, run, _ = aberration_map(pupil, field, wavelength)
        axial, lateral = lens_response.chromatic_aberration.strengths(np.array([wavelength]))[0]
        maps = lens_response.chromatic_aberration.maps(field)
        transverse_aberration = half_diagonal * (
            transverse_aberration + axial * maps[0] * pupil + lateral * maps[1] * field
        )
        assert np.linalg.norm(transverse_aberration) <= 1.02 * reach + 0.02
        assert np.linalg.norm(run) <= 1.02 * stretch
        place = round(np.linalg.norm(field) * (len(table.max_aberration) - 1))
        assert np.linalg.norm(transverse_aberration) <= 1.1 * table.max_aberration[place] + 0.1


def test_a_rim_is_a_way_to_stray():
    plain = lens_table(LensResponse(), Viewport.whole(HEIGHT, WIDTH), CHANCES)
    assert plain.footprint == (1.0, 0.0)
    assert not plain.visible_deviation((HEIGHT, WIDTH), 30.0, 0).any()
    aberration_map = AberrationMap(
        wavelengths=[550.0],
        transverse_aberration=np.zeros((1, 2, 20)),
        pupil_aberration=np.zeros((1, 2, 20)),
        vignetting_apertures=((0.8, 1.0),),
    )
    strayed = lens_table(
        LensResponse(aberration_map=aberration_map), Viewport.whole(HEIGHT, WIDTH), CHANCES
    ).visible_deviation((HEIGHT, WIDTH), 30.0, 0)
    assert strayed[HEIGHT // 2, WIDTH // 2] < 0.2
    assert strayed[0, 0] == 1


def test_a_strip_strays_as_its_rows_of_the_picture():
    aberration_map = random_pencil(np.random.default_rng(7), pupil_aberration=False, dispersive=False)
    table = lens_table(LensResponse(aberration_map=aberration_map), Viewport.whole(HEIGHT, WIDTH), CHANCES)
    whole = table.visible_deviation((HEIGHT, WIDTH), 0.0, 0)
    np.testing.assert_array_equal(table.visible_deviation((100, WIDTH), 0.0, 128), whole[128:228])


def test_a_plane_tilted_too_far_is_refused():
    zeros = np.zeros((1, 2, 20))
    aberration_map = AberrationMap(
        wavelengths=[550.0], transverse_aberration=zeros, pupil_aberration=zeros, tilt=(0.7, 0.7)
    )
    with pytest.raises(ParameterError, match=r"tilt: .* up to 0.8 .* got 0.99"):
        lens_table(LensResponse(aberration_map=aberration_map), Viewport.whole(HEIGHT, WIDTH), CHANCES)

"""Eight rays of a lens at once. Oracle: its pencil map, one ray at a time, in float64."""

import math

import numpy as np
import pytest
from numba import njit

from bokehnet.classical.layered.aberrated_rays import collapse, lens_table, send_rays
from bokehnet.classical.simd.float8 import LANES, load8, store8
from bokehnet.errors import ParameterError
from bokehnet.optics.character import Character
from bokehnet.optics.fringes import Fringes
from bokehnet.optics.pencil import TERMS, PencilMap
from bokehnet.optics.spectrum import LONGEST, SHORTEST

WIDTH, HEIGHT = 400, 300


@njit
def send_eight(coefficients, tilt, u, v, h_x, h_y, waves):
    collapsed = np.empty(coefficients.shape[1:], np.float32)
    collapse(coefficients, h_x * h_x + h_y * h_y, collapsed)
    found = np.empty(4 * LANES, np.float32)
    sent = send_rays(collapsed, tilt, load8(u, 0), load8(v, 0), h_x, h_y, load8(waves, 0))
    store8(found, 0, sent[0])
    store8(found, LANES, sent[1])
    store8(found, 2 * LANES, sent[2])
    store8(found, 3 * LANES, sent[3])
    return found


def random_pencil(rng: np.random.Generator, *, bend: bool, dispersive: bool) -> PencilMap:
    """All terms, and wavelengths on a parabola over 1 / wavelength^2."""
    wavelengths = np.linspace(SHORTEST, LONGEST, 400) if dispersive else np.array([550.0])
    variable = (wavelengths / 550) ** -2 - 1
    powers = variable[:, None] ** np.arange(3) if dispersive else np.ones((1, 1))
    shape = (powers.shape[1], 2 * len(TERMS))
    miss, bent = (powers @ rng.uniform(-0.02, 0.02, shape) for _ in range(2))
    return PencilMap(
        wavelengths=wavelengths,
        miss=miss.reshape(-1, 2, len(TERMS)),
        bend=bent.reshape(-1, 2, len(TERMS)) * bend,
        tilt=(0.2, -0.3) if bend else (0.0, 0.0),
    )


@pytest.mark.parametrize("bend", [False, True])
@pytest.mark.parametrize("dispersive", [False, True])
def test_eight_rays_go_where_the_map_sends_each(bend, dispersive):
    rng = np.random.default_rng(5)
    character = Character(pencil=random_pencil(rng, bend=bend, dispersive=dispersive))
    table = lens_table(character, WIDTH, HEIGHT, 64)
    wavelengths, colors = character.draw(64)
    assert table.coefficients.shape[1:3] == (3 if dispersive else 1, 4 if bend else 2)
    assert table.colors.shape == (3, 64 if dispersive else 0)
    if dispersive:
        np.testing.assert_allclose(table.colors, colors.T, rtol=1e-6)
    half_diagonal = 0.5 * math.hypot(WIDTH, HEIGHT)
    for start in range(0, 64, LANES):
        pupil = rng.uniform(-0.7, 0.7, (LANES, 2)).astype(np.float32)
        field = rng.uniform(-0.7, 0.7, 2).astype(np.float32)
        waves = table.waves[start : start + LANES].copy()
        u, v = np.ascontiguousarray(pupil.T)
        found = send_eight(table.coefficients, table.tilt, u, v, *field, waves).reshape(4, LANES)
        for lane in range(LANES):
            wavelength = wavelengths[start + lane]
            miss, run, _ = character.pencil(pupil[lane].astype(float), field.astype(float), wavelength)
            np.testing.assert_allclose(found[:2, lane], half_diagonal * miss, atol=2e-3)
            np.testing.assert_allclose(found[2:, lane], run, atol=2e-5)


def test_bounds_hold_for_every_ray():
    rng = np.random.default_rng(6)
    pencil = random_pencil(rng, bend=True, dispersive=True)
    character = Character(pencil=pencil, fringes=Fringes(axial=2.0, lateral=-3.0))
    table = lens_table(character, WIDTH, HEIGHT, 64)
    half_diagonal = 0.5 * math.hypot(WIDTH, HEIGHT)
    stretch, reach = table.footprint
    for _ in range(300):
        angle, turn = rng.uniform(0, 2 * math.pi, 2)
        pupil = rng.random() ** 0.5 * np.array([math.cos(angle), math.sin(angle)])
        field = rng.random() * np.array([math.cos(turn), math.sin(turn)])
        wavelength = rng.uniform(SHORTEST, LONGEST)
        miss, run, _ = pencil(pupil, field, wavelength)
        axial, lateral = character.fringes.strengths(np.array([wavelength]))[0]
        maps = character.fringes.maps(field)
        miss = half_diagonal * (miss + axial * maps[0] * pupil + lateral * maps[1] * field)
        assert np.linalg.norm(miss) <= 1.02 * reach + 0.02
        assert np.linalg.norm(run) <= 1.02 * stretch
        place = round(np.linalg.norm(field) * (len(table.largest) - 1))
        assert np.linalg.norm(miss) <= 1.1 * table.largest[place] + 0.1


def test_a_rim_is_a_way_to_stray():
    plain = lens_table(Character(), WIDTH, HEIGHT, 64)
    assert plain.footprint == (1.0, 0.0)
    assert not plain.strayed_at((HEIGHT, WIDTH), 30.0, 0).any()
    pencil = PencilMap(
        wavelengths=[550.0],
        miss=np.zeros((1, 2, 20)),
        bend=np.zeros((1, 2, 20)),
        rims=((0.8, 1.0),),
    )
    strayed = lens_table(Character(pencil=pencil), WIDTH, HEIGHT, 64).strayed_at((HEIGHT, WIDTH), 30.0, 0)
    assert strayed[HEIGHT // 2, WIDTH // 2] < 0.2
    assert strayed[0, 0] == 1


def test_a_strip_strays_as_its_rows_of_the_picture():
    pencil = random_pencil(np.random.default_rng(7), bend=False, dispersive=False)
    table = lens_table(Character(pencil=pencil), WIDTH, HEIGHT, 64)
    whole = table.strayed_at((HEIGHT, WIDTH), 0.0, 0)
    np.testing.assert_array_equal(table.strayed_at((100, WIDTH), 0.0, 128), whole[128:228])


def test_a_plane_that_leans_too_far_is_refused():
    zeros = np.zeros((1, 2, 20))
    pencil = PencilMap(wavelengths=[550.0], miss=zeros, bend=zeros, tilt=(0.7, 0.7))
    with pytest.raises(ParameterError, match=r"focus plane: .* up to 0.8 .* got 0.99"):
        lens_table(Character(pencil=pencil), WIDTH, HEIGHT, 64)

"""Diffusion, overlap and low-rank filters against their equations."""

import math

import numpy as np
import pytest

from bokehnet import baselines
from bokehnet.baselines import diffusion, low_rank, overlap
from bokehnet.baselines.apertures import ladder_positions, psf_image, radius_ladder
from bokehnet.baselines.filters.heat_diffusion import diffuse_rows
from bokehnet.baselines.filters.low_rank_filter import separable_terms
from bokehnet.baselines.filters.overlap_filter import overlap_coverage
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture

# Methods of the literature, which no default uses: their kernels are compiled for the tests.
pytestmark = pytest.mark.slow


def scene(height=20, width=26):
    rng = np.random.default_rng(4)
    image = rng.random((height, width, 3)).astype(np.float32)
    defocus = np.full((height, width), -2.6, np.float32)
    defocus[6:13, 6:15] = 3.3
    defocus[:, 20:] = 0
    return image, defocus


def spot(size):
    image = np.zeros((size, size, 3), np.float32)
    image[size // 2, size // 2] = 1
    return image


def test_one_step_of_diffusion_solves_the_implicit_equation():
    """(I - d/dx b d/dx) y = x, no heat through the ends: the matrix, solved whole."""
    rng = np.random.default_rng(0)
    conductivity = rng.random((3, 17)) * 9
    values = rng.random((3, 17, 2))
    result = values.copy()
    diffuse_rows(result, conductivity)
    for y in range(3):
        between = np.minimum(conductivity[y, :-1], conductivity[y, 1:])
        slope = np.diff(np.eye(17), axis=0)
        system = np.eye(17) + slope.T @ np.diag(between) @ slope
        assert np.allclose(result[y], np.linalg.solve(system, values[y]), atol=1e-12)
    assert np.allclose(result.sum(axis=1), values.sum(axis=1))


def test_diffusion_of_one_defocus_tends_to_the_gaussian_of_the_discs_variance():
    radius, size = 16.0, 129
    at = np.arange(size) - size // 2
    bell = np.exp(-2 * (at / radius) ** 2)  # variance radius^2 / 4
    expected = np.outer(bell, bell) / bell.sum() ** 2
    errors = []
    for steps in (4, 16, 64):
        result = diffusion(spot(size), np.full((size, size), radius), steps=steps)[..., 0]
        errors.append(np.linalg.norm(result - expected) / np.linalg.norm(expected))
        assert (result * at[:, None] ** 2).sum() == pytest.approx(radius**2 / 4, rel=0.01)
    assert errors[2] < 0.01
    assert errors[0] > 3 * errors[1] > 9 * errors[2]  # of first order in the step


def test_heat_stops_dead_at_what_is_sharp():
    image, defocus = scene()
    result = diffusion(image, defocus)
    assert np.array_equal(result[:, 20:], image[:, 20:])


def test_overlap_filter_is_its_equation_column_by_column_then_row_by_row():
    image, defocus = scene()
    half_side = math.sqrt(math.pi) / 2

    def weight(d, distance, centre):
        r = max(half_side * abs(d), 0.5)
        d_p, d_next = distance - 0.5, distance + 0.5  # from the middle of the line that is covered
        covered = 0 if r <= d_p else r - d_p if r < d_next else 1
        leak = min(abs(centre), 1) if d < 0 and distance else 1
        return (1 if distance == 0 else covered) / (2 * r) * leak

    def one_pass(values, radii):
        result = np.zeros(values.shape)
        for y, x in np.ndindex(radii.shape):
            w = np.array([weight(radii[k, x], abs(k - y), radii[y, x]) for k in range(len(radii))])
            result[y, x] = w @ values[:, x] / w.sum()
        return result

    upright = one_pass(image.astype(float), defocus)
    expected = one_pass(upright.transpose(1, 0, 2), defocus.T).transpose(1, 0, 2)
    assert np.abs(overlap(image, defocus) - expected).max() < 1e-5


def test_overlap_share_is_equation_3_18():
    assert [overlap_coverage(2.5, d) for d in (1, 2, 3)] == [1.0, 0.5, 0.0]


def test_low_rank_at_full_rank_spreads_the_image_of_the_opening():
    image, defocus = scene()
    aperture = Aperture(blades=5, spherical_profile=0.6)
    sums = np.zeros((*defocus.shape, 4))
    for side in (1, -1):
        radii = radius_ladder(max(0.0, float((side * defocus).max())))
        low, upper = ladder_positions(defocus, radii, side)
        for y, x in np.argwhere(low >= 0):
            for k, share in ((low[y, x], 1 - upper[y, x]), (low[y, x] + 1, upper[y, x])):
                if share <= 0:
                    continue
                table = psf_image(aperture, float(radii[k]), side)
                half = len(table) // 2
                for v, u in np.ndindex(table.shape):
                    row, column = y + v - half, x + u - half
                    if 0 <= row < len(sums) and 0 <= column < sums.shape[1]:
                        sums[row, column] += share * table[v, u] * np.append(image[y, x], 1)
    expected = sums[..., :3] / sums[..., 3:]
    result = low_rank(image, defocus, aperture, rank=99)
    assert np.abs(result - expected).max() < 2e-4


@pytest.mark.parametrize("aperture", [Aperture(), Aperture(blades=6), Aperture(spherical_profile=0.8)])
def test_what_few_terms_miss_is_what_eckart_and_young_say(aperture):
    psf = psf_image(aperture, 9.0, -1)
    values = np.linalg.svd(psf, compute_uv=False)
    for rank in (1, 2, 4):
        columns, rows = separable_terms(aperture, 9.0, -1, rank, 0.0)
        result = columns.T @ rows
        missing = math.sqrt((values[rank:] ** 2).sum())
        scale = (result * psf).sum() / (result * result).sum()  # terms are scaled so that their sum is 1
        assert np.linalg.norm(scale * result - psf) == pytest.approx(missing, rel=1e-6)
        assert result.sum() == pytest.approx(1)
    few, _ = separable_terms(aperture, 9.0, -1, None, 0.1)
    assert math.sqrt((values[len(few) :] ** 2).sum() / (values**2).sum()) <= 0.1
    assert math.sqrt((values[len(few) - 1 :] ** 2).sum() / (values**2).sum()) > 0.1


def test_a_shape_along_the_axes_needs_fewer_terms():
    square, turned = Aperture(blades=4), Aperture(blades=4, rotation=20)
    assert len(separable_terms(square, 12.0, 1, None, 0.01)[0]) == 1
    assert len(separable_terms(turned, 12.0, 1, None, 0.01)[0]) > 3


def test_ladders_mix_two_radii():
    radii = radius_ladder(20.0)
    assert radii[0] == 0.5
    assert radii[-1] == pytest.approx(20)
    defocus = np.array([[-0.2, -7.3, 7.3, 20.0]], np.float32)
    low, upper = ladder_positions(defocus, radii, -1)
    assert low.tolist()[0][2:] == [-1, -1]
    mixed = radii[low[0, 1]] * (1 - upper[0, 1]) + radii[low[0, 1] + 1] * upper[0, 1]
    assert mixed == pytest.approx(7.3, abs=1e-5)
    assert ladder_positions(defocus, radii, 1)[0].tolist()[0][:2] == [-1, -1]


@pytest.mark.parametrize("name", ["low_rank", "lommel", "perimeter", "hybrid_spreading"])
def test_tables_are_not_made_for_any_radius(name):
    image, defocus = np.random.default_rng(0).random((4, 5, 3)), np.full((4, 5), 300.0)
    with pytest.raises(ParameterError, match=r"^defocus: expected blur radii of at most 256 pixels"):
        getattr(baselines, name)(image, defocus)

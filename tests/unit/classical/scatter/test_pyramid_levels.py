"""Large discs on smaller pictures: against the spread on one level, whose discs are exact."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.scatter.disc_scatter import scatter_forward as spread_on_one_level
from bokehnet.classical.scatter.pyramid_levels import DISC, MERGE_ABOVE, scatter_backward, scatter_forward


def natural_picture(height: int, width: int) -> np.ndarray:
    """Values (H, W, 4) in [0, 1] whose spectrum falls like 1/f, as that of photographs, and ones."""
    rng = np.random.default_rng(0)
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width))
    frequency[0, 0] = 1
    noise = np.fft.rfft2(rng.standard_normal((3, height, width))) / frequency
    picture = np.fft.irfft2(noise, (height, width)).transpose(1, 2, 0)
    picture = (picture - picture.min()) / np.ptp(picture)
    return np.concatenate([picture, np.ones((height, width, 1))], 2).astype(np.float32)


def psnr(values: np.ndarray, defocus: np.ndarray) -> float:
    """Of the normalised pictures with levels and without; peak 1."""
    with_levels, exact = scatter_forward(values, defocus), spread_on_one_level(values, defocus)
    error = with_levels[..., :3] / with_levels[..., 3:] - exact[..., :3] / exact[..., 3:]
    return float(-10 * math.log10((error**2).mean()))


@pytest.mark.parametrize("largest", [16.0, 30.0, 70.0])
@pytest.mark.parametrize("shape", [(150, 203), (128, 192)])
def test_levels_keep_50_db_to_exact_discs(shape, largest):
    """A slope from in front of focus to behind it, with a jump; every radius up to the largest occurs."""
    height, width = shape
    defocus = np.broadcast_to(np.linspace(-largest, largest, width, dtype=np.float32), shape).copy()
    defocus[height // 3 : height // 2, width // 4 : width // 2] = largest
    assert psnr(natural_picture(height, width), defocus) > 50


@pytest.mark.parametrize("radius", [11.1, 16.0, 22.5, 45.5])
def test_levels_keep_50_db_on_noise_of_equal_radii(radius):
    """Nothing smooths over what the levels do: neither the picture nor changing radii."""
    values = np.random.default_rng(1).random((160, 200, 4), dtype=np.float32)
    values[..., 3] = 1
    assert psnr(values, np.full((160, 200), radius, np.float32)) > 50


@pytest.mark.parametrize("radius", [12.5, 20.0, 33.0, 70.0, 200.0])
def test_merged_discs_have_the_exact_variance(radius):
    """Of 16 equal pixels and a disc along an axis: (16^2 - 1) / 12 + r^2 / 4, and 1/12 for the pixel."""
    size = 2 * (math.ceil(1.3 * radius) + 16) // 16 * 16
    values = np.zeros((size, size, 1))
    values[size // 2 - 8 : size // 2 + 8, size // 2 - 8 : size // 2 + 8] = 1 / 256
    defocus = np.full((size, size), radius)
    sums = scatter_forward(values, defocus)[..., 0]
    assert not np.allclose(sums, spread_on_one_level(values, defocus)[..., 0], atol=1e-3 * sums.max())
    place = np.arange(size) - (size - 1) / 2
    assert sums.sum() == pytest.approx(1, abs=1e-6)
    for along in (0, 1):
        variance = (sums.sum(axis=along) * place**2).sum()
        assert variance == pytest.approx(255 / 12 + radius**2 / 4 + 1 / 12, rel=2e-3)


def test_a_light_on_black_keeps_its_sharp_disc():
    values = np.full((120, 120, 4), 1e-3)
    values[60, 61] = 1.0
    light = np.zeros_like(values)
    light[60, 61] = 1.0
    defocus = np.full((120, 120), 40.0)
    rest = scatter_forward(np.full_like(values, 1e-3), defocus)
    disc = spread_on_one_level(light, defocus)
    assert_allclose(scatter_forward(values, defocus) - rest, disc, atol=0.02 * disc.max())


def test_no_light_is_left_behind_the_disc_of_merged_lights():
    values = np.zeros((256, 256, 4), np.float32)
    values[120:136, 120:136] = 1e3
    sums = scatter_forward(values, np.full((256, 256), 50.0, np.float32))
    y, x = np.mgrid[:256, :256] - 127.5
    assert sums[np.hypot(x, y) > 50 + 8 * math.sqrt(2) + 8].max() <= 1e-6 * sums.max()
    assert sums.min() >= 0


def test_sources_at_jumps_and_small_discs_stay_on_their_level():
    """Only discs above the threshold that are alike in their block are merged: below it nothing changes."""
    rng = np.random.default_rng(2)
    values = rng.random((40, 50, 4))
    small = rng.uniform(-MERGE_ABOVE, MERGE_ABOVE, (40, 50))
    checks = np.where(np.indices((40, 50)).sum(axis=0) % 2, 30.0, -30.0)
    for defocus in (small, checks):
        assert_array_equal(scatter_forward(values, defocus), spread_on_one_level(values, defocus))


def test_work_per_level_shrinks_and_the_operator_is_named():
    """Large blur is cheap: only the last level has discs above the threshold."""
    seen = []

    def spread(values, defocus, **place):
        seen.append((values.shape[:2], float(np.abs(defocus).max()), place))
        return DISC.forward(values, defocus, **place)

    values = np.ones((96, 130, 4))
    scatter_forward(values, np.full((96, 130), 80.0), replace(DISC, forward=spread))
    assert [shape for shape, _, _ in seen] == [(12, 17), (24, 33), (48, 65), (96, 130)]
    # Only the column that is left over where a width is odd stays on its level.
    assert [radius > 0 for _, radius, _ in seen] == [True, False, True, False]
    assert seen[0][1] <= MERGE_ABOVE
    assert [place["scale"] for _, _, place in seen] == [8, 4, 2, 1]
    assert all(place["full_shape"] == (96, 130) for _, _, place in seen)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (31, 1), (2, 3), (37, 53)])
@pytest.mark.parametrize("largest", [20.0, 100.0])
def test_backward_is_the_adjoint_of_the_forward(shape, largest):
    """Authority: <spread(v), g> = <v, spread^T(g)>, also where sides are odd."""
    rng = np.random.default_rng(3)
    values = rng.uniform(0.5, 1, (*shape, 4))
    defocus = np.broadcast_to(np.linspace(-largest, largest, shape[1]), shape).copy()
    gradient = rng.standard_normal(values.shape)
    there = (scatter_forward(values, defocus) * gradient).sum()
    back = (values * scatter_backward(values, defocus, gradient)[0]).sum()
    assert back == pytest.approx(there, rel=1e-10)


def test_values_are_left_alone_unless_they_may_be_overwritten():
    values = np.random.default_rng(4).random((30, 40, 4))
    before, defocus = values.copy(), np.full((30, 40), 30.0)
    sums = scatter_forward(values, defocus)
    assert_array_equal(values, before)
    assert_array_equal(scatter_forward(values, defocus, overwrite=True), sums)

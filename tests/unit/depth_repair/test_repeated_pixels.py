"""Detection and reduction of maps that were enlarged by repeating pixels."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from bokehnet.depth_repair.repeated_pixels import undo_pixel_repetition


def soft(height: int, width: int, sigma: float) -> np.ndarray:
    """Return a map with edges, slopes and a flat far region; all its other rows and columns differ."""
    rng = np.random.default_rng(height + width)
    noise = gaussian_filter(rng.random((2, height, width)), (0, sigma, sigma))
    values = np.where(noise[0] > noise[0].mean(), 0.5, 0) + noise[1]
    values[: height // 4] = 0
    return values.astype(np.float32)


@pytest.mark.parametrize("size", [(240, 320), (241, 333), (270, 480), (150, 1000)])
@pytest.mark.parametrize("rounding", ["middle of the pixel", "corner of the pixel"])
def test_the_small_map_is_recovered(size, rounding):
    """Authority: nearest-neighbour interpolation with both roundings of common libraries."""
    small = soft(60, 80, 2)
    half = 0.5 if rounding == "middle of the pixel" else 0
    rows, columns = (
        np.floor((np.arange(large) + half) * count / large + 1e-9).astype(int)
        for large, count in zip(size, small.shape, strict=True)
    )
    np.testing.assert_array_equal(undo_pixel_repetition(small[np.ix_(rows, columns)]), small)


def boxes() -> np.ndarray:
    values = np.zeros((120, 160), np.float32)
    for i in range(6):
        values[10 + 17 * i : 20 + 15 * i, 5 + 20 * i : 19 + 22 * i] = 0.1 * i + 0.2
    return values


@pytest.mark.parametrize(
    "values",
    [
        soft(120, 160, 2),
        np.round(255 * soft(120, 160, 4)) / 255,
        boxes(),
        boxes()[::8, ::8]
        .repeat(8, axis=0)
        .repeat(8, axis=1),  # too few borders to distinguish blocks from boxes
        soft(60, 160, 2).repeat(2, axis=0),  # rows twice, columns once
        np.zeros((120, 160), np.float32),
        np.ones((1, 1), np.float32),
        soft(60, 80, 2).repeat(2, axis=0).repeat(2, axis=1) + np.float32(1e-4) * soft(120, 160, 1),
    ],
)
def test_other_maps_do_not_change(values):
    assert undo_pixel_repetition(values) is values

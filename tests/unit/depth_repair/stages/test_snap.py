"""Soft edges follow colour edges. Authority: scenes with known edges."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.ndimage import gaussian_filter

from bokehnet.depth_repair.filters import local_extremes
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.stages.deblur import snap_soft_edges
from bokehnet.depth_repair.stages.sharpen import repair_soft_edges, soft_pixels


def scene(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a noisy picture of an object with a ragged edge, the true map, and a blurred inaccurate map."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:96, :128]
    near = x + 4 * np.sin(0.4 * y) + 2 * np.sin(1.1 * y) < 64
    colors = np.where(near[..., None], [0.5, 0.2, 0.1], [0.15, 0.3, 0.45])
    image = (colors * (1 + 0.05 * rng.standard_normal((96, 128, 1)))).astype(np.float32)
    truth = np.where(near, 0.8, 0.2).astype(np.float32)
    rough = np.where(x < 64, 0.8, 0.2).astype(np.float32)
    return image, truth, gaussian_filter(rough, 2.5)


@pytest.mark.parametrize("seed", range(3))
def test_soft_edges_move_to_colour_edges(seed):
    image, truth, blurred = scene(seed)
    sharp, soft = repair_soft_edges(blurred), local_extremes(soft_pixels(blurred, 0.03), 2)[1]
    snapped = snap_soft_edges(image, sharp, soft, 0.6)
    misplaced = np.abs(sharp - truth) > 0.3
    assert (np.abs(snapped - truth) > 0.3).sum() < 0.25 * misplaced.sum()
    assert_array_equal(snapped[~soft], sharp[~soft])
    repaired = DisparityRepair().repair(image, blurred, "auto").disparity
    assert (np.abs(repaired - truth) > 0.3).sum() < 0.3 * misplaced.sum()

"""Weighted median at soft edges, against scenes with known edges and a median by sorting."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter

from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.stages import weighted_median
from bokehnet.depth_repair.stages.edge_sharpening import repair_soft_edges
from bokehnet.depth_repair.stages.weighted_median import blurred_edge_mask, snap_blurred_edges
from bokehnet.optics.encoding import encode


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
    sharp, soft = repair_soft_edges(blurred), blurred_edge_mask(blurred)
    snapped = snap_blurred_edges(image, sharp, soft, 0.6)
    misplaced = np.abs(sharp - truth) > 0.3
    assert (np.abs(snapped - truth) > 0.3).sum() < 0.25 * misplaced.sum()
    assert_array_equal(snapped[~soft], sharp[~soft])
    repaired = DisparityRepair().repair(image, blurred, "auto").disparity
    assert (np.abs(repaired - truth) > 0.3).sum() < 0.3 * misplaced.sum()


def test_sharp_edges_are_not_soft():
    truth = scene()[1]
    assert not blurred_edge_mask(truth).any()
    assert blurred_edge_mask(gaussian_filter(truth, 2.0))[:, 50:78].mean() > 0.2


def test_a_pass_equals_the_weighted_median(monkeypatch):
    """Oracle: sorted disparities; the tolerance is one of 24 bins of their range."""
    monkeypatch.setattr(weighted_median, "_PASSES", ((3, 0.05),))
    rng = np.random.default_rng(1)
    image = rng.random((14, 15, 3)).astype(np.float32)
    disparity = rng.random((14, 15)).astype(np.float32)
    snapped = snap_blurred_edges(image, disparity, np.ones((14, 15), bool), 1.0)
    colors = np.asarray(encode(image), float)
    for y in range(14):
        for x in range(15):
            window = np.s_[max(0, y - 3) : y + 4, max(0, x - 3) : x + 4]
            weight = np.exp(-((colors[window] - colors[y, x]) ** 2).sum(-1) / (2 * 0.05**2)).ravel()
            values = disparity[window].ravel()
            order = np.argsort(values)
            cumulative = np.cumsum(weight[order])
            median = values[order][np.searchsorted(cumulative, 0.5 * cumulative[-1])]
            assert_allclose(snapped[y, x], median, atol=np.ptp(values) / 24 + 1e-6)


def test_slopes_are_not_soft_edges():
    slope = np.tile(np.linspace(0, 1, 32, dtype=np.float32), (24, 1))
    assert not blurred_edge_mask(slope).any()


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 17)])
def test_small_maps_stay_finite_and_within_range(shape):
    rng = np.random.default_rng(0)
    disparity = rng.random(shape).astype(np.float32)
    image = 1e5 * rng.random((*shape, 3)).astype(np.float32)
    snapped = snap_blurred_edges(image, disparity, np.ones(shape, bool), 1.0)
    assert np.isfinite(snapped).all()
    assert snapped.min() >= disparity.min()
    assert snapped.max() <= disparity.max()

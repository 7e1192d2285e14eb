"""Alignment of depth edges with the edges of the picture."""

import numpy as np
import pytest

from bokehnet.depth_repair.stages.enlarge import enlarge_changes


def scene(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a noisy picture, red in front of blue with one edge column per row, and the true map."""
    rng = np.random.default_rng(3)
    near = np.arange(48)[None] < columns[:, None]
    image = np.where(near[..., None], [0.7, 0.1, 0.1], [0.1, 0.1, 0.6]) + 0.02 * rng.random(
        (len(near), 48, 3)
    )
    return image.astype(np.float32), np.where(near, 0.9, 0.2).astype(np.float32)


def aligned(image: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    """Return a map whose soft edges are aligned, without changes from a smaller size."""
    small = disparity[::2, ::2]
    return enlarge_changes(image, disparity, small, 0 * small, None, sharpen=True)


@pytest.mark.parametrize("off", [-2, -1, 0, 1, 2])
def test_an_edge_at_most_two_pixels_off_moves_to_the_edge_of_the_picture(off):
    """Authority: the edge in the synthetic picture; it is slanted and crosses blocks of rows."""
    columns = 20 + np.arange(1100) // 100
    image, truth = scene(columns)
    _, shifted = scene(columns + off)
    assert np.mean(aligned(image, shifted)[4:-4] != truth[4:-4]) < 0.001


def test_distant_and_low_edges_do_not_move():
    image, _ = scene(np.full(40, 20))
    _, far_off = scene(np.full(40, 36))
    assert np.array_equal(aligned(image, far_off), far_off)
    _, near_by = scene(np.full(40, 21))
    low = np.where(np.arange(48) < 40, 0.05 * near_by, np.float32(1))
    assert np.array_equal(aligned(image, low)[:, :36], low[:, :36])


def test_a_picture_without_edges_moves_no_edge():
    _, disparity = scene(np.full(40, 20))
    grey = np.full((40, 48, 3), 0.4, np.float32)
    assert np.array_equal(aligned(grey, disparity), disparity)


def test_a_change_of_the_small_map_is_applied_only_where_it_is_allowed():
    """Authority: the true map on the left, and the map before the repair on the right."""
    image, truth = scene(np.full(40, 20))
    _, wrong = scene(np.full(40, 28))
    allowed = np.arange(40)[:, None] < np.full(48, 20)
    small, change = truth[::2, ::2], (truth - wrong)[::2, ::2]
    result = enlarge_changes(image, wrong, small, change, allowed, sharpen=False)
    assert np.array_equal(result[:20], truth[:20])
    assert np.array_equal(result[20:], wrong[20:])

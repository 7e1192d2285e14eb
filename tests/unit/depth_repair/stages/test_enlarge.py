"""Alignment of depth edges with the edges of the picture."""

import numpy as np
import pytest

from bokehnet.depth_repair.stages.enlarge import align_edges


def scene(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a noisy picture, red in front of blue with one edge column per row, and the true map."""
    rng = np.random.default_rng(3)
    near = np.arange(48)[None] < columns[:, None]
    image = np.where(near[..., None], [0.7, 0.1, 0.1], [0.1, 0.1, 0.6]) + 0.02 * rng.random(
        (len(near), 48, 3)
    )
    return image.astype(np.float32), np.where(near, 0.9, 0.2).astype(np.float32)


@pytest.mark.parametrize("off", [-2, -1, 0, 1, 2])
def test_an_edge_at_most_two_pixels_off_moves_to_the_edge_of_the_picture(off):
    """Authority: the edge in the synthetic picture; it is slanted and crosses blocks of rows."""
    columns = 20 + np.arange(1100) // 100
    image, truth = scene(columns)
    _, shifted = scene(columns + off)
    aligned = align_edges(image, shifted, 0.05)
    assert np.mean(aligned[4:-4] != truth[4:-4]) < 0.001


def test_distant_and_low_edges_do_not_move():
    image, _ = scene(np.full(40, 20))
    _, far_off = scene(np.full(40, 30))
    assert np.array_equal(align_edges(image, far_off, 0.05), far_off)
    _, near_by = scene(np.full(40, 21))
    assert np.array_equal(align_edges(image, near_by, 0.8), near_by)


def test_a_picture_without_edges_moves_no_edge():
    _, disparity = scene(np.full(40, 20))
    grey = np.full((40, 48, 3), 0.4, np.float32)
    assert np.array_equal(align_edges(grey, disparity, 0.05), disparity)

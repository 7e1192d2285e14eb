"""Acceptance of a repair. Authority: the edges of the picture, which are known."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.depth_repair.acceptance import accepted_blocks, block_pixels, changed_pixels
from bokehnet.depth_repair.config import RepairConfig
from bokehnet.depth_repair.filters import shift_edges, translate_map
from tests.unit.depth_repair.scenes import blobs, texture, textured

CONFIG = RepairConfig()


def picture(truth):
    return textured(truth).transpose(2, 0, 1)


def changed_blocks(old, new):
    """Return the blocks of 8x8 pixels with a change, (H / 8, W / 8)."""
    changed = changed_pixels(old, new)
    return changed.reshape(changed.shape[0] // 8, 8, -1, 8).any((1, 3))


@pytest.mark.parametrize("pixels", [-3, -2, 2, 3])
def test_changes_towards_the_edges_of_the_picture_are_accepted_and_others_rejected(pixels):
    truth = blobs()
    wrong = shift_edges(truth, pixels)
    blocks = changed_blocks(wrong, truth)
    blocks[:2] = blocks[-2:] = blocks[:, :2] = blocks[:, -2:] = False  # no evidence at the border
    assert accepted_blocks(picture(truth), wrong, truth, CONFIG)[blocks].all()
    assert not accepted_blocks(picture(truth), truth, wrong, CONFIG).any()


def test_a_map_that_is_wrong_on_one_side_is_accepted_only_there():
    truth = blobs(200, 640)
    left = np.arange(640) < 320
    old = np.where(left, translate_map(truth, (0, 4)), truth)
    new = np.where(left, truth, translate_map(truth, (0, 4)))
    accepted = accepted_blocks(picture(truth), old, new, CONFIG)
    blocks = changed_blocks(old, new)
    inner = blocks.copy()
    inner[:2] = inner[-2:] = inner[:, :2] = inner[:, 34:] = False
    assert accepted[inner].mean() > 0.9
    assert not accepted[:, 48:].any()


@pytest.mark.parametrize("pixels", [-2, 2])
def test_nothing_is_accepted_where_both_sides_look_the_same(pixels):
    truth = blobs()
    image = np.where(truth > 0.5, texture(0), texture(1))
    assert not accepted_blocks(image, truth, shift_edges(truth, pixels), CONFIG).any()


@pytest.mark.parametrize("shape", [(1, 1), (7, 40), (64, 100)])
def test_unchanged_maps_of_any_size_are_not_accepted(shape):
    values = np.random.default_rng(0).random(shape, dtype=np.float32)
    accepted = accepted_blocks(np.ones((3, *shape), np.float32), values, values.copy(), CONFIG)
    assert accepted.shape == tuple(-(-side // 8) for side in shape)
    assert not accepted.any()


@pytest.mark.parametrize("scale", [1, 4])
@pytest.mark.parametrize("shape", [(200, 320), (1001, 317)])
def test_blocks_cover_the_pixels_that_they_were_measured_at(shape, scale):
    """Authority: each block repeated over 8 x 8 pixels of the size of the comparison."""
    small = [-(-side // scale) for side in shape]
    blocks = np.random.default_rng(0).random([-(-side // 8) for side in small]) < 0.5
    expected = np.kron(blocks, np.ones((8 * scale, 8 * scale), bool))[: shape[0], : shape[1]]
    assert_array_equal(block_pixels(blocks, shape, scale), expected)

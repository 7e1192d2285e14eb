"""Depth repair in one file. Authorities: true maps, and the stages of the package."""

import numpy as np
import pytest

pytest.importorskip("onnx", reason="needs onnx, of the extra train")

from bokehnet.depth_repair.stages.deblur import snap_soft_edges
from bokehnet.depth_repair.stages.sharpen import repair_soft_edges, soft_edge_fraction, soft_mask
from bokehnet.errors import ModelFileError
from bokehnet.onnx_file import depth_repair
from tests.unit.onnx_file.running import picture, start, steps


@pytest.fixture(scope="module")
def repair():
    """``repair(image, disparity)`` by ONNX Runtime."""
    session = start(depth_repair.build_repair())
    return lambda image, disparity: session.run(None, {"image": image, "disparity": disparity})[0]


def blurred(values, radius):
    """Mean of a square window, border repeated."""
    side = 2 * radius + 1
    padded = np.pad(values, radius, "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (side, side))
    return windows.mean((2, 3)).astype(np.float32)


def painted(disparity, seed=3):
    """Picture whose colours follow the map, with a little texture."""
    colors = np.stack([disparity, 1 - disparity, 0.3 + 0 * disparity], -1)
    return (colors + 0.01 * picture(*disparity.shape, seed)).astype(np.float32)


@pytest.mark.parametrize("radius", [3, 4])
def test_edges_of_a_blurred_map_return_to_those_of_the_picture(repair, radius):
    y, x = np.mgrid[:120, :160]
    truth = np.where(np.hypot(y - 60, x - 70) < 35, 0.9, 0.2).astype(np.float32)
    soft = blurred(truth, radius)
    wrong = [np.abs(values - truth) > 0.1 for values in (soft, repair(painted(truth), soft))]
    assert wrong[0].sum() > 500
    assert wrong[1].sum() < 0.02 * wrong[0].sum()


@pytest.mark.parametrize("scale", [1.0, 40.0])
def test_the_stages_of_the_package_find_the_same(repair, scale):
    truth = (steps(123, 157, 1.0) + 1) / 2
    image, soft = painted(truth), scale * blurred(truth, 3)
    span = float(np.ptp(soft))
    expected = snap_soft_edges(image, repair_soft_edges(soft), soft_mask(soft, span), span)
    assert (np.abs(expected - soft) > 0.05 * span).mean() > 0.02
    assert (np.abs(repair(image, soft) - expected) < 0.01 * span).mean() > 0.99


def test_sharp_maps_stay_to_the_bit(repair):
    disparity = steps(90, 130, 1.0)
    np.testing.assert_array_equal(repair(picture(90, 130), disparity), disparity)


def test_maps_with_few_soft_edges_stay_to_the_bit(repair):
    """As maps of plane sweeps and networks: the file does not judge whether their edges are accurate."""
    y, x = np.mgrid[:100, :200]
    disparity = np.where(np.hypot(y - 50, x % 100 - 50) < 30, 0.9, 0.2).astype(np.float32)
    disparity[:, :100] = blurred(disparity, 3)[:, :100]
    assert 0.3 < soft_edge_fraction(disparity) < 0.7
    np.testing.assert_array_equal(repair(painted(disparity), disparity), disparity)


def test_slopes_and_constant_maps_stay_to_the_bit(repair):
    ramp = np.tile(np.linspace(0, 1, 100, dtype=np.float32), (80, 1))
    for disparity in (ramp, ramp.T.copy(), np.full((70, 60), 3.0, np.float32)):
        np.testing.assert_array_equal(repair(picture(*disparity.shape), disparity), disparity)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (3, 2), (8, 5)])
def test_tiny_maps_are_kept_within_their_range(repair, shape):
    disparity = np.random.default_rng(1).random(shape, dtype=np.float32)
    result = repair(picture(*shape), disparity)
    assert result.shape == shape
    assert disparity.min() <= result.min()
    assert result.max() <= disparity.max()


def test_a_file_that_repairs_otherwise_is_not_written(tmp_path, monkeypatch):
    monkeypatch.setattr(depth_repair, "_expected", lambda image, disparity: disparity)
    with pytest.raises(ModelFileError, match="not written"):
        depth_repair.export_repair(tmp_path / "repair.onnx")
    assert not list(tmp_path.iterdir())

"""Disparity repair with untrained and shipped networks, against accurate maps."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from bokehnet.depth_repair import repair as disparity_repair
from bokehnet.depth_repair.acceptance import accept_repair
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.errors import ModelFileError, ParameterError, ShapeError
from bokehnet.models.onnx_export import export_networks
from bokehnet.models.repair import RepairNet, RepairNetConfig


@pytest.fixture(scope="module")
def untrained(tmp_path_factory):
    """Return the folder of a small network that moves edges at random, and the network."""
    torch.manual_seed(0)
    network = RepairNet(RepairNetConfig(widths=(8, 8, 8)))
    torch.nn.init.normal_(network.unet.head.weight, std=1.0)
    folder = tmp_path_factory.mktemp("repair")
    export_networks({"repair": network}, folder, {})
    return folder, network


def scene(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a noisy picture and the map of a near disc in front of a far wall."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width]
    near = np.hypot(y - 0.5 * height, x - 0.4 * width) < 0.25 * height
    disparity = np.where(near, 0.8, 0.1).astype(np.float32)
    return rng.random((height, width, 3), dtype=np.float32), disparity


def test_the_repair_equals_the_torch_network(untrained, monkeypatch):
    monkeypatch.setattr(disparity_repair, "find_edge_bias", lambda *_: 0)
    monkeypatch.setattr(disparity_repair, "find_map_offset", lambda *_: (0, 0))
    folder, network = untrained
    image, disparity = scene(64, 80)
    span = float(disparity.max() - disparity.min())
    tensors = torch.from_numpy(image).permute(2, 0, 1)[None], torch.from_numpy(disparity)[None, None]
    with torch.no_grad():
        expected, _ = network.eval()(*tensors, torch.full((1, 1, 1, 1), span))
    assert_allclose(DisparityRepair(folder)(image, disparity), expected[0, 0].numpy(), atol=1e-5)


@pytest.mark.parametrize("grown", [0, 320, 640])
def test_an_edge_bias_is_corrected_only_where_the_network_finds_one(untrained, monkeypatch, grown):
    """Bars are two pixels too wide in some columns; network and picture show the accurate bars."""
    columns = np.arange(640) % 24
    accurate = np.tile((columns < 10).astype(np.float32), (64, 1))
    degraded = np.where(np.arange(640) < grown, maximum_filter(accurate, (1, 5), mode="nearest"), accurate)
    repair, inputs = DisparityRepair(untrained[0]), []
    repair._run_tiles = lambda *_: (accurate.copy(), np.zeros(4))
    repair._repair = lambda sizes, maps, *_, **__: inputs.append(maps[0]) or maps[0].copy()
    monkeypatch.setattr(disparity_repair, "is_unbiased", lambda votes: False)
    monkeypatch.setattr(disparity_repair, "find_edge_bias", lambda *_: -2)
    monkeypatch.setattr(disparity_repair, "find_map_offset", lambda *_: (0, 0))
    repair(accurate[..., None] + np.ones(3, np.float32), degraded)
    inner = np.abs(np.arange(640) - grown) > 72
    assert_array_equal(inputs[0][:, inner], accurate[:, inner])


@pytest.mark.parametrize("deviation", [1, 2, 3])
@pytest.mark.parametrize(
    "degrade",
    [lambda d: maximum_filter(d, 5), lambda d: maximum_filter(d, 7), lambda d: minimum_filter(d, 5)],
    ids=["2 px larger", "3 px larger", "2 px smaller"],
)
def test_regions_grown_or_shrunk_and_then_blurred_are_restored(degrade, deviation):
    """Authority: the map before degradation; of 49,152 pixels fewer than five may be wrong."""
    height, width = 192, 256
    y, x = np.mgrid[:height, :width]
    near = np.hypot(y % 64 - 32, x % 64 - 32) < 20
    texture = gaussian_filter(np.random.default_rng(0).standard_normal((height, width)), 2)
    colors = np.where(near[..., None], [0.5, 0.35, 0.2], [0.3, 0.35, 0.4])
    image = (colors * np.exp(0.4 * texture / texture.std())[..., None]).astype(np.float32)
    truth = np.where(near, 0.9, 0.1 + 1e-3 * x).astype(np.float32)
    result = DisparityRepair().repair(image, gaussian_filter(degrade(truth), deviation), "auto")
    assert ((result.disparity > 0.6) != near).mean() < 1e-4


def test_tiles_give_the_same_result_as_the_whole_map(untrained, monkeypatch):
    """The halo covers the receptive field."""
    image, disparity = scene(320, 400)
    repair = DisparityRepair(untrained[0])
    whole = repair(image, disparity)
    monkeypatch.setattr(disparity_repair, "MAX_TILE_PIXELS", 288 * 288)
    near = np.abs(repair(image, disparity) - whole)
    assert_allclose(near, 0, atol=1e-5)
    assert np.abs(whole - disparity).max() > 0.1


def test_the_memory_of_the_network_is_released_before_the_map_is_enlarged(untrained, monkeypatch):
    """The last input of the network is 64 pixels wide, half the picture."""
    for name, side in (("_BASE_SIDE_PX", 40), ("_NETWORK_SIDE_PX", 80)):
        monkeypatch.setattr(disparity_repair, name, side)
    monkeypatch.setattr(disparity_repair, "is_unbiased", lambda votes: True)
    monkeypatch.setattr(disparity_repair, "find_map_offset", lambda *_: (0, 0))
    repair, order = DisparityRepair(untrained[0]), []
    run, release, enlarge = repair._run_network, repair._release_memory, disparity_repair.align_edges
    monkeypatch.setattr(
        repair, "_run_network", lambda image, *a: order.append(image.shape[2]) or run(image, *a)
    )
    monkeypatch.setattr(repair, "_release_memory", lambda: order.append("released") or release())
    monkeypatch.setattr(disparity_repair, "align_edges", lambda *a: order.append("enlarged") or enlarge(*a))
    repair(*scene(128, 128))
    assert order == [32, 64, "released", "enlarged"]


def test_repairs_in_large_pictures_do_not_change_thin_structures_elsewhere(monkeypatch):
    """Authority: the exact map: three alternating depths on the left, a disc on the right, shrunk by 6 px."""
    monkeypatch.setattr(disparity_repair, "_BASE_SIDE_PX", 128)
    y, x = np.mgrid[:192, :256]
    surface = np.where(x < 128, np.digitize(x % 12, [4, 8]), 2 * (np.hypot(y - 96, x - 192) < 40))
    colors = np.array([[0.1, 0.2, 0.6], [0.7, 0.1, 0.1], [0.8, 0.8, 0.3]])
    image = colors[surface] + np.random.default_rng(0).normal(0, 0.01, (192, 256, 3))
    truth = np.array([0.1, 0.5, 0.9], np.float32)[surface]
    degraded = np.where(x < 128, truth, minimum_filter(truth, 13))
    result = DisparityRepair()(image.clip(0).astype(np.float32), degraded)
    disc = np.s_[:, 140:]
    assert np.mean(result[disc] != truth[disc]) < 0.6 * np.mean(degraded[disc] != truth[disc])
    assert np.mean(np.abs(result - truth)[:, :120] > 0.1) < 0.02


@pytest.mark.parametrize(("scale", "offset"), [(37.0, 0.0), (0.01, -3.0)])
def test_the_repair_does_not_depend_on_unit_and_offset(untrained, scale, offset):
    image, disparity = scene(64, 80)
    repair = DisparityRepair(untrained[0])
    unscaled = repair(image, disparity)
    rescaled = repair(image, scale * disparity + offset)
    assert_allclose((rescaled - offset) / scale, unscaled, atol=0.01)


def test_values_stay_within_the_nearby_range_and_flat_maps_do_not_change(untrained):
    image, disparity = scene(61, 83)
    repair = DisparityRepair(untrained[0])
    repaired = repair(image, disparity)
    assert repaired.shape == disparity.shape
    assert repaired.min() >= disparity.min() - 1e-6
    assert repaired.max() <= disparity.max() + 1e-6
    far = np.zeros_like(disparity)
    far[:, 60:] = 1
    assert_array_equal(repaired[far > 0][:4], disparity[far > 0][:4])
    assert_array_equal(repair(image, np.full_like(disparity, 0.3)), np.float32(0.3))


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (7, 5), (300, 1100)])
def test_maps_of_any_size(untrained, size):
    image, disparity = scene(*size)
    disparity[0, 0] = 1
    assert DisparityRepair(untrained[0])(image, disparity).shape == size


def test_auto_does_not_change_maps_with_accurate_edges(untrained):
    """The criterion is the fraction of edge pixels that the repair moves; a random network moves many."""
    image, disparity = scene(64, 80)
    repair = DisparityRepair(untrained[0])
    repaired = repair(image, disparity)
    fraction = accept_repair(disparity, repaired).misplaced_fraction
    assert fraction > 0.1
    assert_array_equal(repair(image, disparity, "auto"), repaired)
    assert_array_equal(repair(image, disparity, "off"), disparity)
    assert accept_repair(disparity, disparity).misplaced_fraction == 0
    refine_none = np.where(np.arange(80) == 3, disparity + 0.5, disparity)
    assert 0 <= accept_repair(disparity, refine_none).misplaced_fraction < fraction


def test_auto_repairs_only_near_misplaced_edges(untrained):
    """The bars on the left are three pixels narrower than those of the network."""
    image = np.ones((320, 960, 3), np.float32)
    columns = np.arange(960) % 24
    accurate = np.tile(np.where(columns < 12, 1, 0).astype(np.float32), (320, 1))
    degraded = accurate.copy()
    degraded[:, :320] = np.where(columns[:320] < 9, 1, 0)
    repair = DisparityRepair(untrained[0])
    repair._run_tiles = lambda *_: (accurate.copy(), np.zeros(4))
    result = repair.repair(image, degraded, "auto")
    assert_array_equal(result.disparity, accurate)
    assert result.repaired
    assert " of the picture" in result.reason
    assert_array_equal(repair.repair(image, accurate, "auto").disparity, accurate)
    with_errors = accurate.copy()
    with_errors[160, 900:910] = 0.5  # ten wrong pixels of the network
    repair._run_tiles = lambda *_: (with_errors.copy(), np.zeros(4))
    unchanged = repair.repair(image, accurate, "auto")
    assert_array_equal(unchanged.disparity, accurate)
    assert not unchanged.repaired
    assert unchanged.reason.startswith("only")


def test_wrong_arguments_raise_errors(untrained, tmp_path):
    image, disparity = scene(20, 30)
    repair = DisparityRepair(untrained[0])
    with pytest.raises(ShapeError, match="30x20 pixels but disparity is 20x30"):
        repair(image, disparity.T)
    with pytest.raises(ParameterError, match="mode: expected one of auto, off, on, got 'always'"):
        repair(image, disparity, "always")
    with pytest.raises(ParameterError, match="NaN"):
        repair(image, np.full_like(disparity, np.nan))
    with pytest.raises(ModelFileError, match="cannot read"):
        DisparityRepair(tmp_path)

"""Disparity repair as users get it."""

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
    """A small network that moves edges at random, and its folder."""
    torch.manual_seed(0)
    network = RepairNet(RepairNetConfig(widths=(8, 8, 8)))
    torch.nn.init.normal_(network.unet.head.weight, std=1.0)
    folder = tmp_path_factory.mktemp("repair")
    export_networks({"repair": network}, folder, {})
    return folder, network


def scene(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """A near disc before a far wall, in a noisy picture."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width]
    near = np.hypot(y - 0.5 * height, x - 0.4 * width) < 0.25 * height
    disparity = np.where(near, 0.8, 0.1).astype(np.float32)
    return rng.random((height, width, 3), dtype=np.float32), disparity


def test_it_equals_the_torch_network(untrained, monkeypatch):
    monkeypatch.setattr(disparity_repair, "find_edge_bias", lambda *_: 0)
    monkeypatch.setattr(disparity_repair, "find_map_offset", lambda *_: (0, 0))
    folder, network = untrained
    image, disparity = scene(64, 80)
    span = float(disparity.max() - disparity.min())
    tensors = torch.from_numpy(image).permute(2, 0, 1)[None], torch.from_numpy(disparity)[None, None]
    with torch.no_grad():
        wanted, _ = network.eval()(*tensors, torch.full((1, 1, 1, 1), span))
    assert_allclose(DisparityRepair(folder)(image, disparity), wanted[0, 0].numpy(), atol=1e-5)


@pytest.mark.parametrize("grown", [0, 320, 640])
def test_a_shift_is_taken_back_where_the_network_asks_for_it(untrained, monkeypatch, grown):
    """Bars that are two pixels too wide in some columns; network and picture show where all should be."""
    columns = np.arange(640) % 24
    right = np.tile((columns < 10).astype(np.float32), (64, 1))
    given = np.where(np.arange(640) < grown, maximum_filter(right, (1, 5), mode="nearest"), right)
    repair, seen = DisparityRepair(untrained[0]), []
    repair._run_tiles = lambda *_: (right.copy(), np.zeros(4))
    repair._repair = lambda sizes, maps, *_, **__: seen.append(maps[0]) or maps[0].copy()
    monkeypatch.setattr(disparity_repair, "is_unbiased", lambda votes: False)
    monkeypatch.setattr(disparity_repair, "find_edge_bias", lambda *_: -2)
    monkeypatch.setattr(disparity_repair, "find_map_offset", lambda *_: (0, 0))
    repair(right[..., None] + np.ones(3, np.float32), given)
    inner = np.abs(np.arange(640) - grown) > 72
    assert_array_equal(seen[0][:, inner], right[:, inner])


@pytest.mark.parametrize("deviation", [1, 2, 3])
@pytest.mark.parametrize(
    "spoil",
    [lambda d: maximum_filter(d, 5), lambda d: maximum_filter(d, 7), lambda d: minimum_filter(d, 5)],
    ids=["2 px larger", "3 px larger", "2 px smaller"],
)
def test_things_grown_or_shrunk_and_then_blurred_come_back(spoil, deviation):
    """Authority: the map before; of 49,152 pixels a handful may stand wrong."""
    height, width = 192, 256
    y, x = np.mgrid[:height, :width]
    near = np.hypot(y % 64 - 32, x % 64 - 32) < 20
    texture = gaussian_filter(np.random.default_rng(0).standard_normal((height, width)), 2)
    colors = np.where(near[..., None], [0.5, 0.35, 0.2], [0.3, 0.35, 0.4])
    image = (colors * np.exp(0.4 * texture / texture.std())[..., None]).astype(np.float32)
    true = np.where(near, 0.9, 0.1 + 1e-3 * x).astype(np.float32)
    found = DisparityRepair().repair(image, gaussian_filter(spoil(true), deviation), "auto")
    assert ((found.disparity > 0.6) != near).mean() < 1e-4


def test_tiles_give_the_same_map_as_the_whole(untrained, monkeypatch):
    """The halo covers all that a pixel depends on."""
    image, disparity = scene(320, 400)
    repair = DisparityRepair(untrained[0])
    whole = repair(image, disparity)
    monkeypatch.setattr(disparity_repair, "MAX_TILE_PIXELS", 288 * 288)
    near = np.abs(repair(image, disparity) - whole)
    assert_allclose(near, 0, atol=1e-5)
    assert np.abs(whole - disparity).max() > 0.1


def test_the_networks_memory_is_given_back_before_the_map_is_enlarged(untrained, monkeypatch):
    """What the network sees last is 64 pixels wide, half the picture."""
    for name, side in (("_BASE_SIDE_PX", 40), ("_NETWORK_SIDE_PX", 80)):
        monkeypatch.setattr(disparity_repair, name, side)
    monkeypatch.setattr(disparity_repair, "is_unbiased", lambda votes: True)
    monkeypatch.setattr(disparity_repair, "find_map_offset", lambda *_: (0, 0))
    repair, order = DisparityRepair(untrained[0]), []
    run, give_back, enlarge = repair._run_network, repair._release_memory, disparity_repair.align_edges
    monkeypatch.setattr(
        repair, "_run_network", lambda image, *a: order.append(image.shape[2]) or run(image, *a)
    )
    monkeypatch.setattr(repair, "_release_memory", lambda: order.append("given back") or give_back())
    monkeypatch.setattr(disparity_repair, "align_edges", lambda *a: order.append("enlarged") or enlarge(*a))
    repair(*scene(128, 128))
    assert order == [32, 64, "given back", "enlarged"]


def test_in_large_pictures_thin_things_stay_where_something_else_is_put_right(monkeypatch):
    """Authority: the exact map: three depths by turns on the left; on the right a disc, shrunk by 6 px."""
    monkeypatch.setattr(disparity_repair, "_BASE_SIDE_PX", 128)
    y, x = np.mgrid[:192, :256]
    surface = np.where(x < 128, np.digitize(x % 12, [4, 8]), 2 * (np.hypot(y - 96, x - 192) < 40))
    colors = np.array([[0.1, 0.2, 0.6], [0.7, 0.1, 0.1], [0.8, 0.8, 0.3]])
    image = colors[surface] + np.random.default_rng(0).normal(0, 0.01, (192, 256, 3))
    true = np.array([0.1, 0.5, 0.9], np.float32)[surface]
    given = np.where(x < 128, true, minimum_filter(true, 13))
    found = DisparityRepair()(image.clip(0).astype(np.float32), given)
    disc = np.s_[:, 140:]
    assert np.mean(found[disc] != true[disc]) < 0.6 * np.mean(given[disc] != true[disc])
    assert np.mean(np.abs(found - true)[:, :120] > 0.1) < 0.02


@pytest.mark.parametrize(("scale", "offset"), [(37.0, 0.0), (0.01, -3.0)])
def test_unit_and_offset_do_not_matter(untrained, scale, offset):
    image, disparity = scene(64, 80)
    repair = DisparityRepair(untrained[0])
    plain = repair(image, disparity)
    other = repair(image, scale * disparity + offset)
    assert_allclose((other - offset) / scale, plain, atol=0.01)


def test_values_stay_between_those_nearby_and_flat_maps_as_they_are(untrained):
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
def test_any_size(untrained, size):
    image, disparity = scene(*size)
    disparity[0, 0] = 1
    assert DisparityRepair(untrained[0])(image, disparity).shape == size


def test_auto_leaves_maps_whose_steps_stand_right(untrained):
    """By the share of pixels near steps that the repair moves; a random network moves many."""
    image, disparity = scene(64, 80)
    repair = DisparityRepair(untrained[0])
    repaired = repair(image, disparity)
    share = accept_repair(disparity, repaired).misplaced_fraction
    assert share > 0.1
    assert_array_equal(repair(image, disparity, "auto"), repaired)
    assert_array_equal(repair(image, disparity, "off"), disparity)
    assert accept_repair(disparity, disparity).misplaced_fraction == 0
    refine_none = np.where(np.arange(80) == 3, disparity + 0.5, disparity)
    assert 0 <= accept_repair(disparity, refine_none).misplaced_fraction < share


def test_auto_repairs_where_steps_stand_out_of_place_and_nowhere_else(untrained):
    """A map of bars, of which those on the left are three pixels narrower than the network wants them."""
    image = np.ones((320, 960, 3), np.float32)
    columns = np.arange(960) % 24
    right = np.tile(np.where(columns < 12, 1, 0).astype(np.float32), (320, 1))
    given = right.copy()
    given[:, :320] = np.where(columns[:320] < 9, 1, 0)
    repair = DisparityRepair(untrained[0])
    repair._run_tiles = lambda *_: (right.copy(), np.zeros(4))
    found = repair.repair(image, given, "auto")
    assert_array_equal(found.disparity, right)
    assert found.repaired
    assert " of the picture" in found.reason
    assert_array_equal(repair.repair(image, right, "auto").disparity, right)
    doubtful = right.copy()
    doubtful[160, 900:910] = 0.5  # ten pixels of a network that errs
    repair._run_tiles = lambda *_: (doubtful.copy(), np.zeros(4))
    kept = repair.repair(image, right, "auto")
    assert_array_equal(kept.disparity, right)
    assert not kept.repaired
    assert kept.reason.startswith("only")


def test_mistakes_are_named(untrained, tmp_path):
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

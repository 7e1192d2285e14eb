"""Disparity repair as users get it."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import maximum_filter

from bokehnet.errors import ModelFileError, ParameterError, ShapeError
from bokehnet.inference import disparity_repair
from bokehnet.inference.disparity_repair import DisparityRepair, misplaced_edge_fraction
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
    folder, network = untrained
    image, disparity = scene(64, 80)
    span = float(disparity.max() - disparity.min())
    tensors = torch.from_numpy(image).permute(2, 0, 1)[None], torch.from_numpy(disparity)[None, None]
    with torch.no_grad():
        wanted, _ = network.eval()(*tensors, torch.full((1, 1, 1, 1), span))
    assert_allclose(DisparityRepair(folder)(image, disparity), wanted[0, 0].numpy(), atol=1e-5)


def test_a_common_shift_is_taken_back_before_the_network_looks(untrained, monkeypatch):
    image, disparity = scene(64, 80)
    repair = DisparityRepair(untrained[0])
    wanted = {}
    for shift in (0, -2):
        monkeypatch.setattr(disparity_repair, "stands_right", lambda votes: False)
        monkeypatch.setattr(disparity_repair, "find_edge_bias", lambda *_, shift=shift: shift)
        wanted[shift] = repair(image, maximum_filter(disparity, 1 - 2 * shift, mode="nearest"))
    assert_allclose(wanted[-2], wanted[0], atol=1e-6)  # opening a disc with a small square leaves it


def test_tiles_give_the_same_map_as_the_whole(untrained, monkeypatch):
    """The halo covers all that a pixel depends on."""
    image, disparity = scene(320, 400)
    repair = DisparityRepair(untrained[0])
    whole = repair(image, disparity)
    monkeypatch.setattr(disparity_repair, "TILE", 288 * 288)
    near = np.abs(repair(image, disparity) - whole)
    assert_allclose(near, 0, atol=1e-5)
    assert np.abs(whole - disparity).max() > 0.1


def test_the_networks_memory_is_given_back_before_the_map_is_enlarged(untrained, monkeypatch):
    """What the network sees last is 64 pixels wide, half the picture."""
    for name, side in (("_LARGEST_SIDE", 40), ("_NETWORK_SIDE", 80)):
        monkeypatch.setattr(disparity_repair, name, side)
    monkeypatch.setattr(disparity_repair, "stands_right", lambda votes: True)
    repair, order = DisparityRepair(untrained[0]), []
    run, give_back, enlarge = repair._run, repair._give_back, disparity_repair.align_steps
    monkeypatch.setattr(repair, "_run", lambda image, *a: order.append(image.shape[2]) or run(image, *a))
    monkeypatch.setattr(repair, "_give_back", lambda: order.append("given back") or give_back())
    monkeypatch.setattr(disparity_repair, "align_steps", lambda *a: order.append("enlarged") or enlarge(*a))
    repair(*scene(128, 128))
    assert order == [32, 64, "given back", "enlarged"]


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
    share = misplaced_edge_fraction(disparity, repaired)
    assert share > 0.1
    assert_array_equal(repair(image, disparity, "auto"), repaired)
    assert_array_equal(repair(image, disparity, "off"), disparity)
    assert misplaced_edge_fraction(disparity, disparity) == 0
    refine_none = np.where(np.arange(80) == 3, disparity + 0.5, disparity)
    assert 0 <= misplaced_edge_fraction(disparity, refine_none) < share


@pytest.mark.parametrize(("moves", "mode", "pixels"), [(0, "auto", 4), (0, "on", 20), (9, "auto", 20)])
def test_auto_looks_at_a_few_windows_of_a_map_that_stands_right(untrained, moves, mode, pixels):
    """A network that moves some columns of every step; counted are its pixels, in windows of 256x256."""
    image, disparity = scene(1000, 1000)
    seen = []

    def network(image, disparity, span):
        seen.append(disparity.size / 256**2)
        moved = disparity.copy()
        moved[..., moves:] = disparity[..., : disparity.shape[-1] - moves]
        return moved, np.zeros((1, 4))

    repair = DisparityRepair(untrained[0])
    repair._network = network
    assert np.array_equal(repair(image, disparity, mode), disparity) == (moves == 0)
    assert sum(seen) <= pixels
    assert (max(seen) <= 1) == (mode == "auto" and moves == 0)


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

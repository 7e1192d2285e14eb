"""Disparity repair against accurate maps."""

import importlib
from unittest import mock

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from bokehnet.depth_repair.config import STAGES, RepairConfig
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.errors import ParameterError, ShapeError
from tests.unit.depth_repair.scenes import blobs, textured


def scene(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a noisy picture and the map of a near disc in front of a far wall."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width]
    near = np.hypot(y - 0.5 * height, x - 0.4 * width) < 0.25 * height
    disparity = np.where(near, 0.8, 0.1).astype(np.float32)
    return rng.random((height, width, 3), dtype=np.float32), disparity


@pytest.mark.parametrize("grown", [0, 320, 640])
def test_growth_is_corrected_only_where_the_picture_supports_it(grown):
    """Discs are three pixels too large in some columns. Authority: the accurate discs."""
    accurate = blobs(200, 640)
    wrong = np.where(np.arange(640) < grown, maximum_filter(accurate, 7, mode="nearest"), accurate)
    result = DisparityRepair().repair(textured(accurate), wrong, "auto")
    inner = np.s_[16:-16, 16:-16]
    error = (np.abs(result.disparity - accurate) > 0.1)[inner].mean()
    assert error <= 0.15 * (np.abs(wrong - accurate) > 0.1)[inner].mean()
    assert result.repaired == (grown > 0)
    assert ("3 px too wide" in result.reason) == (grown == 640)


@pytest.mark.parametrize(
    "degrade",
    [
        lambda d: np.where(np.arange(640) < 320, maximum_filter(d, 7, mode="nearest"), d),
        lambda d: maximum_filter(d, 7, mode="nearest"),
        lambda d: gaussian_filter(d, 2),
    ],
    ids=["3 px larger on the left", "3 px larger", "blurred"],
)
@pytest.mark.parametrize("base_side_px", [1024, 320])
def test_a_frame_with_the_plan_of_its_own_map_equals_the_still(degrade, base_side_px):
    """Authority: the still, which changes."""
    accurate = blobs(200, 640)
    repair = DisparityRepair(config=RepairConfig(base_side_px=base_side_px))
    still = repair.repair(textured(accurate), degrade(accurate), "auto")
    frame = repair.repair(textured(accurate), degrade(accurate), "auto", plan=still.plan)
    assert still.repaired
    assert_array_equal(frame.disparity, still.disparity)
    assert frame.plan == still.plan


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


@pytest.mark.parametrize(("pitch", "wire"), [(24, 5), (24, 7), (36, 5), (36, 7), (48, 5)])
def test_a_blurred_net_keeps_its_place_and_its_wires(pitch, wire):
    """Edges of a wire agree with those of its neighbours, too; authority: the net before blur by 3 px."""
    y, x = np.mgrid[:256, :320]
    near = ((x + y) % pitch < wire) | ((x - y) % pitch < wire)
    texture = gaussian_filter(np.random.default_rng(0).standard_normal(near.shape), 2)
    colors = np.where(near[..., None], [0.15, 0.14, 0.13], [0.45, 0.5, 0.3])
    image = (colors * np.exp(0.25 * texture / texture.std())[..., None]).astype(np.float32)
    truth = np.where(near, 0.8, 0.15 + 2e-4 * x).astype(np.float32)
    result = DisparityRepair().repair(image, gaussian_filter(truth, 3), "auto")
    assert ((result.disparity > 0.5) != near).mean() < 0.01


@pytest.mark.parametrize("wire", [5, 9])
def test_a_net_is_moved_back_by_an_odd_number_of_pixels(wire):
    """Half of the edges of a wire agree with the opposite edges, too; authority: the net where it was."""
    y, x = np.mgrid[:200, :320]
    truth = np.where((x % 36 < wire) | (y % 36 < wire), 0.8, 0.1).astype(np.float32)
    result = DisparityRepair().repair(textured(truth), np.roll(truth, 3, axis=1), "auto")
    assert result.plan.offset == (0, -3)
    assert ((result.disparity > 0.5) != (truth > 0.5))[16:-16, 16:-16].mean() < 0.01


STAGE_FUNCTIONS = {
    "denoise": "repair.without_outliers",
    "sharpen": "repair.repair_soft_edges",
    "register": "diagnosis.find_placement",
    "deblur": "repair.restore_blurred_detail",
    "snap": "repair.snap_soft_edges",
    "thin": "repair.restore_thin_structures",
    "grow": "repair.grow_thin_structures",
}


@pytest.mark.parametrize("name", STAGES)
def test_every_stage_can_be_switched_off(name):
    """The function of a stage runs only if the stage is on; thin structures are snapped too."""
    accurate = np.where(np.arange(320) % 64 < 32, 0.8, 0.1) * np.ones((200, 1), np.float32)
    path = f"bokehnet.depth_repair.{STAGE_FUNCTIONS[name]}"
    module, function = path.rsplit(".", 1)
    original = getattr(importlib.import_module(module), function)
    for stages in (set(STAGES) - {"thin"} | {name}, set(STAGES) - {"thin", name}):
        repair = DisparityRepair(config=RepairConfig(stages=frozenset(stages)))
        with mock.patch(path, wraps=original) as called:
            repair.repair(textured(accurate), gaussian_filter(accurate, 2), "auto")
        assert called.called == (name in stages)


def test_without_stages_the_map_stays():
    image, disparity = scene(64, 80)
    soft = gaussian_filter(disparity, 2)
    assert_array_equal(DisparityRepair(config=RepairConfig(stages=frozenset()))(image, soft), soft)


def test_repairs_in_large_pictures_do_not_change_thin_structures_elsewhere():
    """Authority: the exact map: three alternating depths on the left, a disc on the right, shrunk by 6 px."""
    y, x = np.mgrid[:192, :256]
    surface = np.where(x < 128, np.digitize(x % 12, [4, 8]), 2 * (np.hypot(y - 96, x - 192) < 40))
    colors = np.array([[0.1, 0.2, 0.6], [0.7, 0.1, 0.1], [0.8, 0.8, 0.3]])
    image = colors[surface] + np.random.default_rng(0).normal(0, 0.01, (192, 256, 3))
    truth = np.array([0.1, 0.5, 0.9], np.float32)[surface]
    degraded = np.where(x < 128, truth, minimum_filter(truth, 13))
    repair = DisparityRepair(config=RepairConfig(base_side_px=128))
    result = repair.repair(image.clip(0).astype(np.float32), degraded, "auto").disparity
    disc = np.s_[:, 140:]
    assert np.mean(result[disc] != truth[disc]) < 0.6 * np.mean(degraded[disc] != truth[disc])
    assert np.mean(np.abs(result - truth)[:, :120] > 0.1) < 0.1


@pytest.mark.parametrize(("scale", "offset"), [(37.0, 0.0), (0.01, -3.0)])
def test_the_repair_does_not_depend_on_unit_and_offset(scale, offset):
    image, disparity = scene(64, 80)
    repair = DisparityRepair()
    unscaled = repair(image, disparity)
    rescaled = repair(image, scale * disparity + offset)
    assert_allclose((rescaled - offset) / scale, unscaled, atol=0.01)


def test_values_stay_within_the_nearby_range_and_flat_maps_do_not_change():
    image, disparity = scene(61, 83)
    repair = DisparityRepair()
    repaired = repair(image, disparity)
    assert repaired.shape == disparity.shape
    assert repaired.min() >= disparity.min() - 1e-6
    assert repaired.max() <= disparity.max() + 1e-6
    far = np.zeros_like(disparity)
    far[:, 60:] = 1
    assert_array_equal(repaired[far > 0][:4], disparity[far > 0][:4])
    assert_array_equal(repair(image, np.full_like(disparity, 0.3)), np.float32(0.3))


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (7, 5), (300, 1100)])
def test_maps_of_any_size(size):
    image, disparity = scene(*size)
    disparity[0, 0] = 1
    assert DisparityRepair()(image, disparity).shape == size


def test_auto_does_not_change_maps_with_accurate_edges():
    accurate, repair = blobs(), DisparityRepair()
    result = repair.repair(textured(accurate), accurate, "auto")
    assert_array_equal(result.disparity, accurate)
    assert not result.repaired
    assert result.reason == "no edge is clearly out of place"
    assert_array_equal(repair(textured(accurate), accurate, "off"), accurate)


def test_auto_does_not_change_maps_without_relation_to_the_picture():
    """The discs of the picture lie elsewhere; authority: the map itself."""
    accurate = blobs()
    smooth = gaussian_filter(np.random.default_rng(1).standard_normal(accurate.shape), 9)
    unrelated = (np.digitize(smooth / smooth.std(), [-0.8, 0, 0.8]) / 3).astype(np.float32)
    result = DisparityRepair().repair(textured(accurate), unrelated, "auto")
    assert_array_equal(result.disparity, unrelated)
    assert result.reason == "its edges do not follow the picture"


def test_wrong_arguments_raise_errors():
    image, disparity = scene(20, 30)
    repair = DisparityRepair()
    with pytest.raises(ShapeError, match="30x20 pixels but disparity is 20x30"):
        repair(image, disparity.T)
    with pytest.raises(ParameterError, match="mode: expected one of auto, off, on, got 'always'"):
        repair(image, disparity, "always")
    with pytest.raises(ParameterError, match="NaN"):
        repair(image, np.full_like(disparity, np.nan))


def test_arguments_of_the_earlier_network_have_no_effect():
    with pytest.warns(DeprecationWarning, match="the repair has no network"):
        repair = DisparityRepair(threads=1)
    image, disparity = scene(64, 80)
    assert_array_equal(repair(image, disparity), DisparityRepair()(image, disparity))

"""Offset and growth of maps that were displaced by known numbers of pixels."""

import numpy as np
import pytest

from bokehnet.depth_repair.config import RepairConfig
from bokehnet.depth_repair.filters import shift_edges, translate_map
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.stages.register import NO_PLACEMENT, find_placement
from tests.unit.depth_repair.scenes import blobs, texture, textured

CONFIG = RepairConfig()


def picture(truth):
    return textured(truth).transpose(2, 0, 1)


@pytest.mark.parametrize("offset", [(0, 1), (0, -2), (3, 0), (-4, 4), (5, -6), (-1, -7)])
def test_a_translated_map_is_moved_back(offset):
    """Authority: the translation that the map has undergone."""
    truth = blobs()
    placement = find_placement(picture(truth), translate_map(truth, offset), CONFIG)
    assert placement.offset == (-offset[0], -offset[1])
    assert placement.growth == 0


@pytest.mark.parametrize("pixels", [-5, -4, -3, -2, 2, 3, 4, 5])
def test_grown_and_shrunk_maps_are_restored_without_translation(pixels):
    """Authority: the width of the window with which the map was filtered."""
    truth = blobs()
    placement = find_placement(picture(truth), shift_edges(truth, pixels), CONFIG)
    assert placement.offset == (0, 0)
    assert placement.growth == -pixels


@pytest.mark.parametrize(("pixels", "offset"), [(2, (0, 3)), (-2, (-3, 2))])
def test_offset_and_growth_are_separated(pixels, offset):
    truth = blobs()
    displaced = translate_map(shift_edges(truth, pixels), offset)
    placement = find_placement(picture(truth), displaced, CONFIG)
    assert placement.offset == (-offset[0], -offset[1])
    assert placement.growth == -pixels


@pytest.mark.parametrize("seed", range(3))
def test_maps_stay_where_nothing_supports_a_displacement(seed):
    """Accurate maps, pictures without edges, and maps without relation to the picture."""
    truth = blobs()
    assert find_placement(picture(truth), truth, CONFIG) == NO_PLACEMENT
    assert find_placement(np.full((3, 200, 320), 0.4, np.float32), truth, CONFIG) == NO_PLACEMENT
    assert find_placement(texture(seed), truth, CONFIG) == NO_PLACEMENT


@pytest.mark.parametrize("shape", [(1, 1), (40, 300), (64, 64)])
def test_small_maps_and_maps_without_edges_stay(shape):
    image = np.ones((3, *shape), np.float32)
    assert find_placement(image, np.zeros(shape, np.float32), CONFIG) == NO_PLACEMENT


@pytest.mark.slow
@pytest.mark.parametrize("offset", [(0, 2), (-2, 3), (0, 0)])
@pytest.mark.parametrize("factor", [1, 4])
def test_the_repair_translates_a_map_and_reports_it(offset, factor):
    """Large pictures are aligned at a smaller size."""
    truth = blobs()
    translated, image = translate_map(truth, offset), textured(truth)
    if factor > 1:
        translated, truth = (x.repeat(factor, 0).repeat(factor, 1) for x in (translated, truth))
        image = image.repeat(factor, 0).repeat(factor, 1)
    result = DisparityRepair().repair(image, translated, "auto")
    inner = np.s_[8 * factor : -8 * factor, 8 * factor : -8 * factor]
    assert (np.abs(result.disparity - truth) > 0.1)[inner].mean() <= 5e-4
    assert result.plan.offset == (-factor * offset[0], -factor * offset[1])
    descriptions = {
        (0, 2): f"the map lay {2 * factor} px too far right; corrected",
        (
            -2,
            3,
        ): f"the map lay {3 * factor} px too far right; the map lay {2 * factor} px too high; corrected",
    }
    assert result.reason.startswith(descriptions.get(offset, "no edge"))
    if offset != (0, 0):
        planned = DisparityRepair().repair(image, translated, "auto", plan=result.plan)
        assert (np.abs(planned.disparity - truth) > 0.1)[inner].mean() <= 5e-4

"""Examples for the disparity repair."""

import numpy as np
import pytest

from train.data.repair_data import RepairDataConfig, repair_pair


@pytest.mark.parametrize(("part", "span"), [(128, 1.0), (512, 0.25)])
def test_a_piece_of_a_larger_picture_counts_as_a_whole_one(part, span):
    """On a slope a crop shows the piece's own range: all of it, or its share of the whole."""
    disparity = np.broadcast_to(np.linspace(3, 7, 512, dtype=np.float32), (512, 512))
    image = np.repeat(disparity[..., None], 3, 2)
    config = RepairDataConfig(folder="", validation="", clean=1.0, bent=0.0, crop=128, part=part)
    for seed in range(4):
        pair = repair_pair(image, disparity, np.random.default_rng(seed), config)
        assert pair["image"].shape == (3, 128, 128)
        assert np.ptp(pair["truth"]) == pytest.approx(span, abs=0.01)
        np.testing.assert_array_equal(pair["disparity"], pair["truth"])

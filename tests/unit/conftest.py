"""A card with a displaced map, and the maps that the repair receives, for tests of repeated renders."""

import numpy as np
import pytest

HEIGHT, WIDTH = 64, 96


def displaced_card():
    """Return picture and map of a card in front of a texture; the map lies four pixels beside the card."""
    rng = np.random.default_rng(5)
    image = rng.uniform(0.2, 0.8, (HEIGHT, WIDTH, 3)).astype(np.float32) ** 2
    image[16:48, 30:60] = (0.9, 0.1, 0.1)
    values = np.full((HEIGHT, WIDTH), 0.1, np.float32)
    values[16:48, 34:64] = 0.8
    return image, values


@pytest.fixture
def repairs(monkeypatch):
    """Return the list of maps that the repair receives."""
    from bokehnet.depth_repair.repair import DisparityRepair  # not for tests without repair

    maps = []
    repair = DisparityRepair.repair

    def counted(self, image, disparity, *arguments, **keywords):
        maps.append(disparity)
        return repair(self, image, disparity, *arguments, **keywords)

    monkeypatch.setattr(DisparityRepair, "repair", counted)
    return maps

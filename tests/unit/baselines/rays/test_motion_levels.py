"""Level of detail for motion blur."""

import math

import numpy as np
import pytest

from bokehnet.baselines.rays.mesh_views import level_of_detail
from bokehnet.baselines.rays.motion_levels import motion_level, moving_views, times_by_level
from tests.unit.baselines.rays.test_mesh_views import LENS, PICTURE, card


def test_the_level_is_that_of_a_disc_as_wide_as_the_motion():
    assert motion_level(16.0, 400.0, 64) == pytest.approx(level_of_detail(math.pi * 64, 400.0, 64))
    assert motion_level(0.0, 400.0, 64) == 0


def test_groups_are_evenly_spread_and_share_the_views():
    groups = times_by_level(1.25, 16, 5)
    assert [number for number, _ in groups] == [1, 2]
    assert [len(times) for _, times in groups] == [12, 4]
    for _, times in groups:
        assert np.diff(times) == pytest.approx(1 / len(times))
        assert times.mean() == pytest.approx(0.5)
    assert times_by_level(9.0, 8, 2)[0][0] == 2


def test_flat_cards_move_alike_at_all_levels():
    """Authority: the same views of the finest level; a moved card covers its path."""
    mesh = card(1000.0, 40.0, (1.0, 0.5, 0.2))
    moving = [(mesh, np.array([150.0, 0.0, 0.0]))]
    fine = moving_views(moving, LENS, PICTURE, 24, levels=False)
    coarse = moving_views(moving, LENS, PICTURE, 24)
    assert coarse.triangles < fine.triangles
    still = moving_views([(mesh, np.zeros(3))], LENS, PICTURE, 24, levels=False)
    assert fine.bokeh.sum() == pytest.approx(still.bokeh.sum(), rel=0.1)  # whole pixels
    assert (fine.bokeh[..., 0] > 0).sum() > (still.bokeh[..., 0] > 0).sum()
    assert np.abs(coarse.bokeh - fine.bokeh).mean() < 0.02

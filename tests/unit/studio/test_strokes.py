"""Strokes on a depth map: their effects, edges, sizes and mistakes."""

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.studio.strokes import Stroke, painted

FLAT = np.full((40, 60), 0.5, np.float32)
GREY = np.full((40, 60, 3), 0.3, np.float32)


@pytest.mark.parametrize(("effect", "sign"), [("nearer", 1), ("farther", -1)])
def test_nearer_raises_disparity_by_the_strength(effect, sign):
    values = np.tile(np.linspace(0.25, 0.75, 60, dtype=np.float32), (40, 1))
    stroke = Stroke(effect=effect, points=((0.5, 0.5),), radius=0.1, strength=0.2)
    moved = painted(values, GREY, [stroke]) - values
    assert moved[20, 30] == pytest.approx(sign * 0.2 * 0.5, abs=1e-6)  # of the map's range
    assert (moved[0] == 0).all()


def test_same_takes_the_depth_where_the_stroke_begins():
    values = FLAT.copy()
    values[:, 30:] = 0.9
    stroke = Stroke(effect="same", points=((0.9, 0.5), (0.1, 0.5)), radius=0.05)
    result = painted(values, GREY, [stroke])
    assert (result[20, 8:52] == np.float32(0.9)).all()
    assert set(np.unique(result)) == {np.float32(0.5), np.float32(0.9)}  # no surface between the two


def test_sharp_follows_the_focus_and_goes_last():
    sharp = Stroke(effect="sharp", points=((0.5, 0.5),), radius=0.1)
    nearer = Stroke(effect="nearer", points=((0.5, 0.5),), radius=0.1, strength=0.5)
    for focus in (0.1, 0.7):
        assert painted(FLAT, GREY, [sharp, nearer], focus)[20, 30] == np.float32(focus)


def test_hidden_takes_the_depth_of_the_farthest_surface_around_the_stroke():
    values = FLAT.copy()
    values[:, :28] = 0.2
    stroke = Stroke(effect="hidden", points=((0.5, 0.5),), radius=0.1)
    result = painted(values, GREY, [stroke])
    assert (result[16:24, 28:34] == np.float32(0.2)).all()
    assert (result[:, 40:] == 0.5).all()
    assert set(np.unique(result)) == {np.float32(0.2), np.float32(0.5)}


def test_a_brush_that_heeds_edges_stops_at_them():
    image = GREY.copy()
    image[:, 32:] = 0.9
    reports = {"effect": "nearer", "points": ((0.45, 0.5),), "radius": 0.15, "strength": 0.5}
    heeding, heedless = (painted(FLAT, image, [Stroke(**reports, edges=edges)]) for edges in (True, False))
    assert heeding[20, 27] > 0.6
    assert (heeding[:, 32:] == 0.5).all()
    assert heedless[20, 33] > 0.6


def test_a_stroke_is_the_same_on_maps_of_any_size():
    stroke = Stroke(effect="nearer", points=((0.3, 0.4), (0.6, 0.5)), radius=0.1, strength=0.5)
    small = painted(FLAT, GREY, [stroke])
    large = painted(
        np.kron(FLAT, np.ones((4, 4), np.float32)), np.kron(GREY, np.ones((4, 4, 1), np.float32)), [stroke]
    )
    assert np.abs(large.reshape(40, 4, 60, 4).mean((1, 3)) - small).mean() < 0.005


@pytest.mark.parametrize(
    "wrong",
    [
        {"radius": 0},
        {"radius": 3},
        {"points": []},
        {"points": [[9, 9]]},
        {"effect": "delete"},
        {"strength": -1},
        {"points": 3},
    ],
)
def test_wrong_strokes_are_refused(wrong):
    table = {"effect": "nearer", "points": [[0.5, 0.5]], "radius": 0.1} | wrong
    with pytest.raises(ParameterError, match=r"^stroke"):
        Stroke.from_table(table)

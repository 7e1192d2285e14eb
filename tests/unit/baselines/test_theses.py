"""The probes of ``benchmarks.quality.theses`` and its table."""

import math

import numpy as np
import pytest

from benchmarks.experiments.edges.pan import flicker, pan
from benchmarks.quality import theses
from benchmarks.quality.scenes.fault_probes import FAULTS, disc_of_lamp, edge_profile, faults, ringing
from benchmarks.quality.tables.theses_table import merged, table
from bokehnet.baselines import BASELINES
from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.optics.aperture import Aperture
from train.scores.metrics import encode


def test_the_profile_is_the_share_of_a_disc_on_one_side():
    y, x = np.mgrid[-2000:2001, -2000:2001] / 2000
    inside = np.hypot(x, y) <= 1
    for distance in (-0.8, 0.0, 0.3):
        expected = (inside & (x <= distance)).sum() / inside.sum()
        assert edge_profile(np.array([distance * 12]), 12.0)[0] == pytest.approx(expected, abs=1e-3)
    assert disc_of_lamp().sum() == pytest.approx(1)
    assert disc_of_lamp().max() == pytest.approx(1 / (math.pi * 144), rel=0.01)


def test_probes_bring_out_the_faults():
    truth = faults(lambda image, defocus: theses.render_with("rays")(image, defocus, Aperture()))
    assert truth["leak"] < 1
    assert truth["outline"] < 2
    assert truth["disc"] < 1
    scatter = faults(lambda image, defocus: theses.render_with("scatter")(image, defocus, Aperture()))
    assert scatter["leak"] > 10  # as all that know no order
    assert scatter["outline"] > 10
    none = faults(lambda image, defocus: 0.5 * image)
    assert none["disc"] > 90
    assert none["light"] == pytest.approx(-50)
    tinted = faults(lambda image, defocus: image * np.array([1, 1, 0]))
    assert tinted["colour"] > 5


def test_ringing_is_the_sum_of_all_rises_outwards():
    """Authority: discs that fall all the way have none; a ring of a quarter above the disc has a quarter."""
    y, x = np.mgrid[-48:49, -48:49]
    distance = np.rint(np.hypot(x, y))
    flat = np.where(distance <= 12, 2.0, 0.0)
    assert ringing(flat, 2.0) == 0
    assert ringing(np.exp(-(distance**2) / 50), 1.0) == 0
    assert ringing(flat + 0.5 * (distance == 8), 2.0) == pytest.approx(0.25)
    assert ringing(flat - 0.2 * (distance == 15), 2.0) == pytest.approx(0.1)  # below black, and back


def test_one_table_lists_all_with_a_dash_for_missing_runs():
    scores = {"edge": 30.0, "psnr": 33.0, "flip": 0.1}
    first = {"scenes": {"a": {"tan": scores, "rays": scores}}, "faults": {"tan": dict.fromkeys(FAULTS, 1.0)}}
    second = {
        "scenes": {"b": {"tan": scores | {"edge": 20.0}}},
        "costs": {"rays": {"seconds": 2.0, "memory": 210.4, "flicker": 0.5}},
        "faults": {"tan": dict.fromkeys(FAULTS, -0.01)},
    }
    result = table(merged([first, second]), theses.METHODS).splitlines()
    rows = {
        line.split(" | ")[0].strip("| "): line.strip("| ").split(" | ") for line in result if line[:1] == "|"
    }
    assert rows["method"][1:4] == ["a", "b", "mean"]
    assert rows["tan"][1:7] == [
        "30.00 / 33.00 / 0.1000",
        "20.00 / 33.00 / 0.1000",
        "25.00 / 33.00 / 0.1000",
        *"---",
    ]
    assert set(rows["tan"][7:]) == {"0.0"}  # of the later run, and no minus before it
    assert rows["rays"][2:7] == ["-", "-", "2.00", "210", "0.50"]
    assert len(rows) == 4
    assert sum("no row, as it draws a scene" in line for line in result) == 2


def test_methods_that_know_only_discs_render_discs():
    image, defocus = np.random.default_rng(0).random((20, 20, 3)), np.full((20, 20), 3.0)
    result = theses.render_with("overlap")(image, defocus, Aperture(blades=6))
    assert np.array_equal(result, theses.render_with("overlap")(image, defocus, Aperture()))
    assert set(BASELINES) < set(theses.METHODS)


def test_scenes_that_are_not_there_are_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("benchmarks.experiments.edges.pan._TRUTH", 4)
    monkeypatch.setattr("sys.argv", ["theses", str(tmp_path), "--engine", "rectangle"])
    theses.main()
    message = capsys.readouterr().out
    assert message.count("skipped, as") == len(theses.SCENES)
    assert "rectangle" in message


@pytest.mark.slow
def test_figures_of_the_first_scene(shared):
    """Lower bounds of the quality at edges of two shots of the still life."""
    folder = shared("cycles") / "s1_still_life"
    least = {"perimeter": 33.9, "overlap": 33.3, "gather_bokeh": 36.4, "rays": 38.0}
    means = theses.print_scene(folder, {name: theses.render_with(name) for name in least}, 2)
    for name, edge in least.items():
        assert means[name]["edge"] > edge


def test_flicker_is_what_changes_of_an_error():
    """Authority: an error that stays is none; one of +-e in turns changes by 2e."""
    truth = np.full((4, 6, 3), 0.2)
    shown = encode(truth)
    steady = [truth * 1.5] * 4
    assert flicker(steady, [truth] * 4) == 0
    turns = [np.asarray(srgb_to_linear(shown + sign * 0.01)) for sign in (1, -1, 1, -1)]
    assert flicker(turns, [truth] * 4) == pytest.approx(2, rel=1e-3)


def test_a_pan_moves_the_picture_by_a_quarter_of_a_pixel_a_frame(monkeypatch):
    """Authority: after four frames the picture lies a pixel to the side, and noise is all that differs."""
    monkeypatch.setattr("benchmarks.experiments.edges.pan._TRUTH", 16)
    frames = pan(5)
    first, last = frames[0], frames[4]
    same = np.abs(first.defocus[:, :-1] - last.defocus[:, 1:]) < 1e-2
    assert same.mean() > 0.995  # rounding moves an edge here and there
    errors = [
        np.abs(encode(first.image[:, ahead]) - encode(last.image[:, behind])).mean()
        for ahead, behind in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1)))
    ]
    assert errors[0] < 0.3 * errors[1]

"""The probes of ``benchmarks.theses`` and its table."""

import math

import numpy as np
import pytest

from benchmarks import theses
from benchmarks.fault_probes import disc_of_lamp, edge_profile, faults
from benchmarks.pan import flicker, pan
from bokehnet.baselines import BASELINES
from bokehnet.io.color import srgb_to_linear
from bokehnet.optics.aperture import Aperture
from train.metrics import encode


def test_the_profile_is_the_share_of_a_disc_on_one_side():
    y, x = np.mgrid[-2000:2001, -2000:2001] / 2000
    inside = np.hypot(x, y) <= 1
    for distance in (-0.8, 0.0, 0.3):
        wanted = (inside & (x <= distance)).sum() / inside.sum()
        assert edge_profile(np.array([distance * 12]), 12.0)[0] == pytest.approx(wanted, abs=1e-3)
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


def test_methods_that_know_only_discs_render_discs():
    image, defocus = np.random.default_rng(0).random((20, 20, 3)), np.full((20, 20), 3.0)
    found = theses.render_with("overlap")(image, defocus, Aperture(blades=6))
    assert np.array_equal(found, theses.render_with("overlap")(image, defocus, Aperture()))
    assert set(BASELINES) < set(theses.METHODS)


def test_scenes_that_are_not_there_are_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["theses", str(tmp_path), "--engine", "rectangle"])
    theses.main()
    told = capsys.readouterr().out
    assert told.count("skipped, as") == len(theses.SCENES)
    assert "rectangle" in told


@pytest.mark.slow
def test_figures_of_the_first_scene(shared):
    """What was reached at edges of two shots of the still life; less is a step back."""
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
    monkeypatch.setattr("benchmarks.pan._TRUTH", 16)
    frames = pan(5)
    first, last = frames[0], frames[4]
    same = np.abs(first.defocus[:, :-1] - last.defocus[:, 1:]) < 1e-2
    assert same.mean() > 0.995  # rounding moves an edge here and there
    errors = [
        np.abs(encode(first.image[:, ahead]) - encode(last.image[:, behind])).mean()
        for ahead, behind in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1)))
    ]
    assert errors[0] < 0.3 * errors[1]

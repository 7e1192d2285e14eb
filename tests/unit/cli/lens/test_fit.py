"""``bokehnet lens fit`` where it has nothing to fit; the fit itself is tested in ``unit/lenses/fit``."""

from functools import partial

import numpy as np
import pytest

from bokehnet.classical.scatter_renderer import scatter
from bokehnet.io.image import read_image, write_image, write_map
from bokehnet.optics.aperture import Aperture
from bokehnet.tools import pair_fit


def test_a_picture_without_lamps_is_refused_and_nothing_written(cli, tmp_path):
    write_image(tmp_path / "a.png", np.full((40, 50, 3), 0.1, np.float32))
    outcome = cli("lens", "fit", tmp_path / "a.png", "-o", tmp_path / "look.toml")
    assert outcome.code == 1
    assert "lights: expected at least one isolated blurred lamp, found none" in outcome.err
    assert not (tmp_path / "look.toml").exists()


def test_lamps_that_are_no_numbers_are_refused(cli, tmp_path):
    write_image(tmp_path / "a.png", np.full((40, 50, 3), 0.1, np.float32))
    for lights in ("3,4", "x,y,r", "3,4,-1"):
        outcome = cli("lens", "fit", tmp_path / "a.png", "-o", tmp_path / "look.toml", "--lights", lights)
        assert outcome.code == 1
        assert "--lights: expected" in outcome.err


def test_a_sharp_picture_needs_its_disparity(cli, tmp_path):
    write_image(tmp_path / "a.png", np.full((40, 50, 3), 0.1, np.float32))
    outcome = cli(
        "lens", "fit", tmp_path / "a.png", "--sharp", tmp_path / "a.png", "-o", tmp_path / "look.toml"
    )
    assert outcome.code == 1
    assert "--sharp: expected --sharp and --disparity, got one of them" in outcome.err


@pytest.mark.slow
def test_a_pair_names_blur_and_focus_in_option_units(cli, tmp_path, no_bar, monkeypatch):
    """Authority: the scatter that blurred the picture; blades are tried in ``test_pair_fit.py``."""
    monkeypatch.setattr(pair_fit, "fit_pair", partial(pair_fit.fit_pair, blades=()))
    monkeypatch.setattr(pair_fit, "_STARTS", 1)
    monkeypatch.setattr(pair_fit, "_ITERATIONS", 6)
    rng = np.random.default_rng(0)
    image = rng.uniform(0.02, 0.06, (60, 80, 3))
    image[rng.integers(4, 56, 12), rng.integers(4, 76, 12)] += 20  # lamps
    write_image(tmp_path / "a.exr", image.astype(np.float32))
    ramp = np.broadcast_to(np.linspace(0, 1, 80), (60, 80))
    write_map(tmp_path / "d.exr", ramp.astype(np.float32), channel="disparity")
    common = ["--disparity", tmp_path / "d.exr"]
    defocus = (10 * (ramp - 0.3)).astype(np.float32)
    write_image(tmp_path / "b.exr", scatter(image.astype(np.float32), defocus, Aperture(cats_eye=0.4)))
    outcome = cli(
        *("lens", "fit", tmp_path / "b.exr", "--sharp", tmp_path / "a.exr", *common),
        *("-o", tmp_path / "look.toml", "--residual", tmp_path / "left.png"),
    )
    assert outcome.code == 0, outcome.err
    reports = {line.split()[0]: line.split()[1] for line in outcome.out.splitlines()}
    assert float(reports["blur"]) == pytest.approx(10, rel=0.05)
    assert float(reports["focus"]) == pytest.approx(0.3, abs=0.02)
    assert 'description = "Fitted to a pair of pictures"' in (tmp_path / "look.toml").read_text()
    assert read_image(tmp_path / "left.png").shape == (60, 240, 3)

"""``bokehnet lens fit`` where it has nothing to fit; the fit itself is tested in ``unit/lenses/look_fit``."""

import numpy as np
import pytest

from bokehnet.io.image import read_image, write_image, write_map


def test_a_picture_without_lamps_is_refused_and_nothing_written(cli, tmp_path):
    write_image(tmp_path / "a.png", np.full((40, 50, 3), 0.1, np.float32))
    outcome = cli("lens", "fit", tmp_path / "a.png", "-o", tmp_path / "look.toml")
    assert outcome.code == 1
    assert "lights: expected at least one blurred lamp that stands alone, found none" in outcome.err
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
def test_a_pair_tells_blur_and_focus_as_options_take_them(cli, tmp_path, no_bar):
    """Authority: the command that blurred the picture."""
    rng = np.random.default_rng(0)
    image = rng.uniform(0.02, 0.06, (60, 80, 3))
    image[rng.integers(4, 56, 12), rng.integers(4, 76, 12)] += 20  # lamps
    write_image(tmp_path / "a.exr", image.astype(np.float32))
    ramp = np.broadcast_to(np.linspace(0, 1, 80), (60, 80))
    write_map(tmp_path / "d.exr", ramp.astype(np.float32), channel="disparity")
    common = ["--disparity", tmp_path / "d.exr"]
    taken = cli(
        *("render", tmp_path / "a.exr", *common, "--blur", 12, "--focus", 0.3, "--cats-eye", 0.4),
        *("--engine", "scatter", "-o", tmp_path / "b.exr"),
    )
    assert taken.code == 0, taken.err
    outcome = cli(
        *("lens", "fit", tmp_path / "b.exr", "--sharp", tmp_path / "a.exr", *common),
        *("-o", tmp_path / "look.toml", "--residual", tmp_path / "left.png"),
    )
    assert outcome.code == 0, outcome.err
    told = {line.split()[0]: line.split()[1] for line in outcome.out.splitlines()}
    assert float(told["blur"]) == pytest.approx(12, rel=0.05)
    assert float(told["focus"]) == pytest.approx(0.3, abs=0.02)
    assert 'description = "Fitted to a pair of pictures"' in (tmp_path / "look.toml").read_text()
    assert read_image(tmp_path / "left.png").shape == (60, 240, 3)

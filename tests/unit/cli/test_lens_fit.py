"""``bokehnet lens fit`` where it has nothing to fit; the fit itself is tested in ``unit/lenses/look_fit``."""

import numpy as np

from bokehnet.io.image import write_image


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

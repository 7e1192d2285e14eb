"""``bokehnet lens``."""

import re

import pytest

from bokehnet.lenses import catalog_names


def test_without_a_name_the_catalog_is_listed(cli):
    outcome = cli("lens")
    assert (outcome.code, outcome.err) == (0, "")
    for name in catalog_names():
        assert name in outcome.out
    assert "100 mm f/2, Double Gauss" in outcome.out


def test_a_lens_is_described(cli):
    outcome = cli("lens", "double_gauss", "--focal", 50, "--f-number", 2.8, "--focus", 2)
    assert (outcome.code, outcome.err) == (0, "")
    assert re.search(r"focal length +50\.000 mm by matrix, 49\.99\d mm traced", outcome.out)
    assert re.search(
        r"f-number +2\.800 paraxial, 2\.8\d\d working; fully open 2\.02\d paraxial, published 2", outcome.out
    )
    for label in ("source", "principal planes", "exit pupil", "depth of field", "rays that pass"):
        assert label in outcome.out
    assert "focus                2 m from the entrance pupil" in outcome.out


def test_a_file_is_described_and_drawn(cli, tmp_path, no_bar):
    pytest.importorskip("matplotlib")
    text = 'name = "Mine"\nsource = "me"\nfocal_length = 100.0\nf_number = 10.0\nimage_radius = 10.0\n'
    text += "[[surfaces]]\nstop = true\nthickness = 1.0\nsemi_diameter = 5.0\n"
    text += "[[surfaces]]\nradius = 100.0\nthickness = 3.0\nabbe = [1.5, 60.0]\nsemi_diameter = 9.0\n"
    text += "[[surfaces]]\nradius = -100.0\nthickness = 90.0\nsemi_diameter = 9.0\n"
    (tmp_path / "mine.toml").write_text(text)
    outcome = cli("lens", tmp_path / "mine.toml", "--plot", tmp_path / "out.png")
    assert (outcome.code, outcome.err) == (0, "")
    assert "Mine" in outcome.out
    assert (tmp_path / "out.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nolens"], ["'nolens'", "double_gauss"]),
        (["no.toml"], ["no.toml"]),
        (["retrofocus", "--focus", "0.05"], ["Retrofocus", "cannot focus at 50 mm"]),
        (["double_gauss", "--f-number", "1"], ["f-number", "2.02"]),
        (["double_gauss", "--focal", "-5"], ["focal length above 0"]),
        (["--focal", "50"], ["NAME: expected a lens or a TOML file", "got none"]),
        (["biconvex", "--plot", "nowhere/out.png"], ["nowhere/out.png"]),
    ],
)
def test_mistakes_are_one_line(cli, arguments, words):
    outcome = cli("lens", *arguments)
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err.startswith("bokehnet: error: ")
    assert outcome.err.count("\n") == 1
    for word in words:
        assert word in outcome.err

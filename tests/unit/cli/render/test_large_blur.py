"""Expected time of very large blur. Authority: the rule, more than 15 % of the width."""

import pytest

from bokehnet.cli.render import large_blur
from bokehnet.cli.render.large_blur import expected_seconds, large_blur_notice
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.errors import BokehnetError

WORDS = (
    "render",
    "photo.png",
    "--disparity",
    "disparity.png",
    "--engine",
    "scatter",
    "--repair-disparity",
    "off",
)


@pytest.mark.parametrize(("radius", "shown"), [(15, False), (15.1, True), (900, True)])
def test_the_notice_begins_above_fifteen_percent(radius, shown):
    assert bool(large_blur_notice("rays", 100, 300, radius)) == shown


def test_the_time_rises_with_pixels_and_radius_up_to_the_longer_side():
    assert expected_seconds("rays", 200, 100, 50) > expected_seconds("rays", 200, 100, 20)
    assert expected_seconds("rays", 200, 100, 200) == expected_seconds("rays", 200, 100, 9000)
    assert expected_seconds("rays", 400, 200, 50) == pytest.approx(4 * expected_seconds("rays", 200, 100, 50))


def test_a_large_blur_warns_without_a_terminal(folder, cli):
    outcome = cli(*WORDS, "--blur", 100, "--focus", 0.4, "-o", "out.png")
    assert outcome.code == 0
    assert "blur up to 60 px, 94 % of the width: expect about 1 s" in outcome.err
    assert cli(*WORDS, "--blur", 100, "--focus", 0.4, "-o", "out.png", "-q").err == ""
    assert "expect about" not in cli(*WORDS, "--blur", 9, "--focus", 0.4, "-o", "out.png").err


def test_a_large_blur_warns_before_the_repair(folder, cli, monkeypatch):
    def refuse(*_, **__):
        raise BokehnetError("repairing")

    monkeypatch.setattr(DisparityRepair, "repair", refuse)
    outcome = cli(*WORDS[:-1], "on", "--blur", 100, "--focus", 0.4, "-o", "out.png")
    assert outcome.code == 1
    assert "expect about" in outcome.err.split("repairing")[0]


@pytest.mark.parametrize(("answer", "code"), [("n\n", 1), ("y\n", 0)])
def test_a_terminal_is_asked_before_a_long_render(folder, cli, monkeypatch, answer, code):
    """The terminal is replaced: two streams that say that they are one."""
    import io
    import sys

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr(large_blur, "_LONG_SECONDS", 0.0)
    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    outcome = cli(*WORDS, "--blur", 100, "--focus", 0.4, "-o", "out.png", "--json")
    assert outcome.code == code
    assert ("nothing rendered" in outcome.err) == (code == 1)
    assert (folder / "out.png").exists() == (code == 0)

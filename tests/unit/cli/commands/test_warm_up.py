"""``bokehnet warm-up``: after it, nothing is left to compile."""

import re

import pytest

from bokehnet.cli.commands.warm_up import _LOOKS, _PLAIN
from bokehnet.precompiled.kernel import KERNELS
from bokehnet.render.renderer import BokehRenderer
from bokehnet.tools.demo import demo_settings, small_demo_scene


def known():
    return {(name, types) for name, kernel in KERNELS.items() for types in kernel.machine_code}


def test_it_reports_how_many_kernels_are_ready(cli, no_bar):
    outcome = cli("warm-up", "--all")
    assert (outcome.code, outcome.err) == (0, "")
    match = re.fullmatch(r"ready: (\d+) kernels shipped precompiled, (\d+) compiled by numba\n", outcome.out)
    assert match is not None
    assert int(match[1]) + int(match[2]) >= len(known()) > 20


@pytest.mark.slow
def test_pictures_of_other_sizes_need_nothing_more(cli, no_bar):
    """Every look of the command, at twice its size."""
    assert cli("warm-up", "--all").code == 0
    before = known()
    renderer, scene = BokehRenderer(), small_demo_scene()
    for look in (*_PLAIN, *_LOOKS):
        renderer.render(scene, demo_settings("near").updated(look))
    assert known() == before

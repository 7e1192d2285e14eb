"""Options reach the kernels through few files; the command of ``tools/hops.py`` counts them."""

import pytest

from tools.hops import way_of

# A change that adds a layer between command line and kernels has to say so here.
MAX_FILES = {"blur": 13, "focus": 13, "disparity": 16, "blades": 11}

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("option", MAX_FILES)
def test_the_way_is_short_and_enters_each_room_once(option):
    way = way_of(option)
    assert way.files[0] == "cli/app.py"
    assert way.files[-1].startswith(("classical/", "optics/"))
    assert len(way.files) <= MAX_FILES[option]
    assert way.re_entered == []

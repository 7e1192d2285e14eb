"""The Lua plug-in in the real darktable-cli. Authority: the command line, of what darktable shows it."""

import shutil
import subprocess
import sys

import numpy as np
import pytest

from bokehnet.io.image import read_image, write_image, write_map
from tests.conftest import ROOT
from tests.hosts.archives import install

DARKTABLE = shutil.which("darktable-cli")

pytestmark = [
    pytest.mark.host,
    pytest.mark.skipif(DARKTABLE is None, reason="needs darktable-cli: apt-get install darktable"),
]

SCRIPT = """
local dt = require "darktable"
local bokehnet = require "bokehnet"
dt.preferences.write("bokehnet", "command", "string", "{program}")
dt.preferences.write("bokehnet", "options", "string", "{options}")
local begun = false
dt.register_event("test", "intermediate-export-image", function()
  if begun then return end
  begun = true
  local image = dt.database.import("{photo}")
  print("MADE", bokehnet.edit(image))
  print("LEADER", #image:get_group_members())
end)
"""


@pytest.fixture
def darktable(tmp_path):
    """Edit a photograph with its disparity beside it; return what darktable printed.

    darktable-cli runs Lua in a thread of its own beside the export that it was called for, and dies now and
    then where both export at once. The edit therefore waits for that export, of a picture large enough to end
    after the script has asked for it.
    """
    program = tmp_path / "bokehnet"
    program.write_text(
        f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m bokehnet "$@"\n', encoding="utf-8"
    )
    program.chmod(0o755)
    disparity = np.zeros((60, 80), np.float32)
    disparity[:, 30:50] = 1
    columns = np.linspace(0, 1, 80, dtype=np.float32)
    picture = np.stack([np.tile(columns, (60, 1)), disparity * 0.5, np.full((60, 80), 0.2)], -1)
    picture[::8] = 1
    write_image(tmp_path / "photo.png", picture.astype(np.float32))
    write_map(tmp_path / "photo.disparity.png", disparity)
    install("darktable", tmp_path / "dt", tmp_path / "downloads")
    write_image(tmp_path / "large.png", np.full((2000, 2000, 3), 0.5, np.float32))

    def run(options="--blur 6 --focus 1 --repair-disparity off", command=program):
        script = SCRIPT.format(program=command, options=options, photo=tmp_path / "photo.png")
        (tmp_path / "edit.lua").write_text(script, encoding="utf-8")
        folders = ["--configdir", tmp_path / "dt", "--cachedir", tmp_path / "dt", "--library", ":memory:"]
        words = [tmp_path / "large.png", tmp_path / "plain.png", "--core", *folders]
        words = [DARKTABLE, *words, "--luacmd", f'dofile("{tmp_path}/edit.lua")']
        return subprocess.run(
            [str(word) for word in words], capture_output=True, text=True, timeout=120
        ).stdout

    return run


@pytest.mark.slow
def test_an_edited_picture_appears_next_to_the_original(darktable, tmp_path, cli):
    message = darktable()
    result = tmp_path / "photo.bokeh.tif"
    assert f"MADE\t{result}" in message
    assert "LEADER\t2" in message
    disparity = tmp_path / "photo.disparity.png"
    lens = ["--blur", "6", "--focus", "1", "--repair-disparity", "off"]
    by_command = tmp_path / "command.tif"
    assert cli("render", tmp_path / "photo.png", "--disparity", disparity, *lens, "-o", by_command).code == 0
    assert np.abs(read_image(result) - read_image(by_command)).max() < 0.02  # through darktable's own colours
    assert np.abs(read_image(result) - read_image(tmp_path / "photo.png")).max() > 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"options": "--blur minus"}, "--blur"),
        ({"command": "/nowhere/bokehnet"}, "/nowhere/bokehnet"),
    ],
)
def test_what_is_wrong_is_one_line(darktable, tmp_path, arguments, message):
    (line,) = [line for line in darktable(**arguments).splitlines() if line.startswith("MADE")]
    assert line.startswith("MADE\tnil\t")
    assert message in line
    assert not (tmp_path / "photo.bokeh.tif").exists()

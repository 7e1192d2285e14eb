import numpy as np
import pytest

from bokehnet.io.channels import read_channels
from bokehnet.io.maps import read_depth


def test_one_file_holds_all_outputs(cli, scene, tmp_path):
    outcome = cli("trace", scene, "-o", tmp_path / "out.exr")
    assert (outcome.code, outcome.err) == (0, "")
    channels = read_channels(tmp_path / "out.exr")
    assert set(channels.channels) == {
        *"RGBZ",
        *(f"all_in_focus.{name}" for name in "RGB"),
        *(f"normal.{name}" for name in "XYZ"),
        "disparity",
        "id",
        "coverage",
    }
    assert channels.attributes["bokehnet:samples"] == "8"
    assert channels.attributes["bokehnet:bodies"] == '["floor", "ball"]'
    assert read_depth(tmp_path / "out.exr")[8, 12] == pytest.approx(1100, rel=0.01)
    assert channels.channels["id"][8, 12] == 2
    assert channels.channels["id"][0, 0] == 0
    assert channels.channels["disparity"][8, 12] == pytest.approx(1 / 1.1, rel=0.01)
    assert channels.channels["normal.Z"][8, 12] < -0.95
    assert channels.channels["R"].shape == (16, 24)


def test_more_samples_go_on_from_those_in_the_file(cli, scene, tmp_path):
    cli("trace", scene, "-o", tmp_path / "part.exr", "--samples", 3)
    assert cli("trace", scene, "-o", tmp_path / "part.exr", "--samples", 12).code == 0
    cli("trace", scene, "-o", tmp_path / "whole.exr", "--samples", 12)
    part, whole = (read_channels(tmp_path / name) for name in ("part.exr", "whole.exr"))
    assert part.attributes["bokehnet:samples"] == "12"
    for name, values in whole.channels.items():
        assert np.array_equal(part.channels[name], values), name
    again = cli("trace", scene, "-o", tmp_path / "part.exr", "--samples", 5)
    assert "already has 12 samples" in again.out


def test_a_picture_of_another_scene_is_not_touched_but_with_fresh(cli, scene, tmp_path):
    out = tmp_path / "out.exr"
    cli("trace", scene, "-o", out)
    old = out.read_bytes()
    outcome = cli("trace", scene, "-o", out, "--seed", 1)
    assert outcome.code == 1
    assert "is not of this scene, size and seed" in outcome.err
    assert out.read_bytes() == old
    assert cli("trace", scene, "-o", out, "--seed", 1, "--fresh", "--width", 12, "--height", 8).code == 0
    assert read_channels(out).channels["R"].shape == (8, 12)


# Ctrl-C reaches the program while it traces, once at least three samples are done.
INTERRUPTED = """
import os, signal, sys, threading
from bokehnet.cli.app import main
from bokehnet.raytrace.tracer import Tracer
advance = Tracer.advance
def watched(self, film, samples):
    if film.samples >= 3:  # again if the first was lost: Python drops what is raised in some callbacks
        threading.Timer(0.005, os.kill, (os.getpid(), signal.SIGINT)).start()
    return advance(self, film, samples)
Tracer.advance = watched
sys.argv[0] = "bokehnet"
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
main()
"""


def test_ctrl_c_keeps_the_samples_so_far_and_the_same_command_completes_them(
    scene, tmp_path, cli, python_process
):
    out, whole = tmp_path / "out.exr", tmp_path / "whole.exr"
    size = ("--width", 240, "--height", 160, "--samples")
    outcome = python_process(INTERRUPTED, "trace", scene, "-o", out, *size, 100000)
    assert outcome.code == 130
    assert outcome.err.splitlines()[-1] == "bokehnet: interrupted"
    assert "Traceback" not in outcome.err
    done = int(read_channels(out).attributes["bokehnet:samples"])
    assert 3 <= done < 20
    assert f"{done} of 100000 samples" in outcome.out
    for path in (out, whole):
        assert cli("trace", scene, "-o", path, *size, done + 3).code == 0
    first, second = (read_channels(path).channels for path in (out, whole))
    for name, values in second.items():
        assert np.array_equal(first[name], values), name


def test_layers_are_written_front_to_back(cli, scene, tmp_path):
    outcome = cli("trace", scene, "-o", tmp_path / "layers.exr", "--layers", 3)
    assert (outcome.code, outcome.err) == (0, "")
    channels = read_channels(tmp_path / "layers.exr").channels
    assert len(channels) == 18
    assert np.abs(channels["R"] - channels["layer1.R"]).mean() < 0.1  # the picture of all layers
    assert channels["layer1.Z"][9, 12] == pytest.approx(1.1, rel=0.02)
    assert channels["layer2.Z"][9, 12] > 1.3
    assert channels["layer3.coverage"].max() == 1


def test_mistakes_are_one_line(cli, scene, tmp_path):
    for arguments, message in (
        (("none.toml", "-o", tmp_path / "a.exr"), "cannot read config none.toml"),
        ((scene, "-o", tmp_path / "a.png"), "unknown extension '.png'"),
        ((scene, "-o", tmp_path / "no" / "a.exr"), "does not exist"),
        (
            (scene, "-o", tmp_path / "a.exr", "--device", "abacus"),
            "--device: expected a device that torch can use here, got 'abacus'",
        ),
        ((scene, "-o", tmp_path / "a.exr", "--width", "0"), "camera: width: expected at least 1"),
    ):
        outcome = cli("trace", *arguments)
        assert outcome.code == 1
        assert message in outcome.err
        assert outcome.err.count("\n") == 1
    assert not (tmp_path / "a.exr").exists()

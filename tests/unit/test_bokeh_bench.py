"""The public benchmark: its files, its commands, its pins."""

import json
import shlex
import sys

import numpy as np
import pytest

from benchmarks.bokeh_bench import VERSION, __main__, running, scenes
from bokehnet.errors import DataFileError
from bokehnet.io.image import read_image, write_image
from bokehnet.io.maps import read_disparity
from bokehnet.lenses import ThinLens
from train.scores.evaluation_sets import path_traced_shots


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A scene of few rays."""
    pytest.importorskip("embreex", reason="needs embreex: pip install 'bokehnet[trace]'")
    made = tmp_path_factory.mktemp("bench")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenes, "_HALF_SAMPLES", 4)
        patch.setattr(scenes, "_IMAGE_SAMPLES", 4)
        patch.setattr(scenes, "_WIDTH", 64)
        patch.setattr(scenes, "_HEIGHT", 48)
        scenes.make_scene("room", made / "room")
    return made


@pytest.fixture
def run(folder, monkeypatch, capsys):
    """Run the command line on that scene, pinned as it is."""
    pins = {"room": json.loads((folder / "room/scene.json").read_text())["summary"]}
    (folder / "pins.json").write_text(json.dumps(pins))
    monkeypatch.setattr(__main__, "_PINS", folder / "pins.json")

    def call(*arguments):
        command = ["bokeh_bench", "--folder", folder, "--scene", "room", *arguments]
        monkeypatch.setattr(sys, "argv", [str(part) for part in command])
        __main__.main()
        return capsys.readouterr().out

    return call


def test_what_is_told_of_the_lens_gives_the_blur_that_was_traced(folder):
    """Authority: the formula of the README, in metres, with the depth that is written."""
    scene = json.loads((folder / "room/scene.json").read_text())
    assert scene["benchmark"] == VERSION
    low, high = scene["disparity"]["min"], scene["disparity"]["max"]
    grey = read_image(folder / "room/image.png").shape
    assert grey == (48, 64, 3)
    for shot, told in zip(path_traced_shots(folder / "room"), scene["shots"], strict=True):
        assert np.abs(shot.defocus).max() == pytest.approx(told["largest_radius_px"], rel=1e-4)
        wanted = running.placeholders(scene, folder / "room", told, folder)
        disparity = np.asarray(read_disparity(folder / "room/disparity.png"))
        by_disparity = float(wanted["blur"]) * (disparity - float(wanted["focus"]))
        assert np.abs(by_disparity - shot.defocus).max() < 0.02
        assert low < 1 / told["focus_distance_m"] < high
    assert scene["shots"][0]["largest_radius_px"] == pytest.approx(16, rel=1e-3)


def test_the_noise_of_the_truth_is_that_of_the_mean_of_both_halves():
    """Oracle: many means of two noisy pictures against the picture itself."""
    rng = np.random.default_rng(0)
    clean = np.full((60, 80, 3), 0.3)
    halves = [clean + rng.normal(0, 0.01, clean.shape) for _ in range(2)]
    told = scenes._noise(halves, np.ones((60, 80), bool))
    error = scenes.encode((halves[0] + halves[1]) / 2) - scenes.encode(clean)
    assert told["psnr"] == pytest.approx(-10 * np.log10((error**2).mean()), abs=0.1)
    assert told["edge_psnr"] == told["psnr"]


def test_a_command_and_an_engine_give_one_result(run, folder, tmp_path):
    (tmp_path / "method.py").write_text(
        "import sys\nfrom bokehnet.io.image import read_image, write_image\n"
        "write_image(sys.argv[2], read_image(sys.argv[1]), bits='float')\n"
    )
    command = f"{shlex.quote(sys.executable)} {tmp_path / 'method.py'} {{image}} {{out}}"
    told = run("--method", command, "--name", "copy", "--json", tmp_path / "copy.json")
    assert "| copy |" in told
    assert "Noise of the truth alone" in told
    run("--engine", "no_blur", "--json", tmp_path / "none.json")
    first, second = (json.loads((tmp_path / name).read_text()) for name in ("copy.json", "none.json"))
    assert first["benchmark"] == VERSION
    assert first["versions"]["numpy"] == np.__version__
    for key in running.SCORES:
        assert first["mean"][key] == pytest.approx(second["mean"][key], rel=1e-5)
        assert first["mean"][key] == pytest.approx(np.mean([shot[key] for shot in first["shots"]]))
    table = run("--table", tmp_path / "copy.json", tmp_path / "none.json")
    assert table.count("\n") == 4


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("mine {picture} {out}", "--method: expected placeholders image, image_png"),
        ("mine {image}", "--method: expected {out} or {out_png}"),
        ("false {out}", "false .*: exit status 1"),
        ("echo no such option >&2; exit 3; {out}", "exit status 3: no such option"),
        ("true {out}", "found none"),
        ("cp {small} {out}", "--method: expected placeholders"),
        ("cp SMALL {out}", r"room/bokeh_00.exr: expected finite \(48, 64, 3\), got \(8, 8, 3\)"),
        ("cp NAN {out}", "NaN or infinity|not finite|NaN"),
    ],
)
def test_what_a_command_does_wrong_is_one_line_and_nothing_is_written(run, tmp_path, command, message):
    write_image(tmp_path / "small.exr", np.ones((8, 8, 3), np.float32))
    from bokehnet.io.channels import write_channels

    write_channels(tmp_path / "nan.exr", dict.fromkeys("RGB", np.full((48, 64), np.nan)))
    command = command.replace("SMALL", str(tmp_path / "small.exr")).replace("NAN", str(tmp_path / "nan.exr"))
    with pytest.raises(SystemExit, match=message) as caught:
        run("--method", command, "--json", tmp_path / "a.json")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "a.json").exists()


def test_other_pictures_are_not_scored(folder):
    pinned = json.loads((folder / "room/scene.json").read_text())["summary"]
    scenes.prepare(folder, ["room"], {"room": pinned})
    off = [[1.02 * value for value in row] for row in pinned]
    with pytest.raises(DataFileError, match="expected the pinned scene"):
        scenes.prepare(folder, ["room"], {"room": off})
    with pytest.raises(DataFileError, match="remove the folder"):
        scenes.prepare(folder, ["room"], {})


def test_blades_cut_what_the_opening_says():
    """Authority: the area of a hexagon in its circle, 3 sqrt(3) / (2 pi)."""
    lens = ThinLens(focal_length=50.0, f_number=2.0, focus_distance=1000.0)
    square = np.random.default_rng(0).random((100000, 2)) * 2 - 1
    points = square[np.hypot(*square.T) <= 1]
    bladed = scenes._BladedLens(lens, scenes.Aperture(blades=6))
    weight = bladed.sample_rays(np.zeros_like(points), points).weight
    assert weight.mean() == pytest.approx(3 * np.sqrt(3) / (2 * np.pi), abs=0.01)
    assert set(np.unique(weight)) == {0.0, 1.0}

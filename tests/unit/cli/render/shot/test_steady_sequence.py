"""Sequences of files as one shot. Authority: maps without their noise; runs that were not stopped."""

import json
import shutil

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.cli.render.shot import shot_files, workers
from bokehnet.io.image import read_image, write_image, write_map
from bokehnet.io.maps import read_map
from bokehnet.sequence import shot as shot_module
from bokehnet.sequence.filtered_shot import FilteredShot
from bokehnet.sequence.video import VideoJob

FRAMES = range(1, 7)
SHOT = ["render", "in.####.png", "--disparity", "z.####.exr", "-o", "out.####.png", "--engine", "scatter"]
SHOT += ["--blur", "8", "--focus", "0.3", "--frames", "1-6"]
TRUTH = np.where(np.arange(96) < 48, 0.2, 0.8) * np.ones((64, 1))


@pytest.fixture
def noisy(tmp_path, monkeypatch):
    """Six equal pictures of two surfaces; each map has noise of its own."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    grain = np.repeat(rng.random((64, 96, 1)), 3, 2)
    picture = np.where(TRUTH[..., None] > 0.5, 0.5 + 0.3 * grain, 0.2 * grain).astype(np.float32)
    for frame in FRAMES:
        write_image(f"in.{frame:04d}.png", picture)
        write_map(f"z.{frame:04d}.exr", (TRUTH + 0.02 * rng.standard_normal(TRUTH.shape)).astype(np.float32))
    return tmp_path


def bytes_of(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("out.*"))}


def hidden(folder):
    return [path.name for path in folder.rglob(".bokehnet-*")]


def test_maps_of_files_are_made_steady(noisy, cli):
    outcome = cli(*SHOT, "--save-maps", "maps", "--repair-disparity", "off", "--json")
    assert outcome.code == 0, outcome.err
    summary = json.loads(outcome.out)
    assert (summary["steady"], summary["plan"]) == (True, None)
    maps = np.stack([read_map(f"maps/{frame:04d}/defocus.exr") for frame in FRAMES])
    # Six draws have 1 / sqrt(6) of one's deviation, and neighbouring frames nearly the same ones.
    assert np.sqrt(np.square(maps - 8 * (TRUTH - 0.3)).mean()) < 8 * 0.02 * 0.6
    assert np.diff(maps, axis=0).std() < 8 * 0.02 * 0.1
    assert hidden(noisy) == []


@pytest.mark.parametrize("steady", ["on", "off"])
def test_the_repair_is_decided_once(noisy, cli, steady):
    summary = json.loads(cli(*SHOT, "--steady", steady, "--json").out)
    assert set(summary["plan"]) == {
        "repaired",
        "softness",
        "shift",
        "offset",
        "noise",
        "local_shift",
        "thin_fraction",
        "wrong_pixels",
    }
    assert {frame["repaired"] for frame in summary["frames"].values()} == {summary["plan"]["repaired"]}


def test_each_frame_is_left_alone_when_that_is_requested(noisy, cli):
    words = ["--steady", "off", "--save-maps", "maps", "--repair-disparity", "off", "--json"]
    outcome = cli(*SHOT, *words)
    assert json.loads(outcome.out)["steady"] is False
    for frame in FRAMES:
        values = read_map(f"z.{frame:04d}.exr")
        np.testing.assert_allclose(read_map(f"maps/{frame:04d}/defocus.exr"), 8 * (values - 0.3), atol=1e-4)


def test_equal_frames_of_a_shot_give_equal_files(noisy, cli):
    for frame in FRAMES[1:]:
        shutil.copy("z.0001.exr", f"z.{frame:04d}.exr")
    assert cli(*SHOT).code == 0
    assert len(set(bytes_of(noisy).values())) == 1


def test_parts_of_a_shot_have_its_frames(noisy, cli):
    """Authority: the whole shot, byte for byte, with the repair decided for the whole."""
    assert cli(*SHOT).code == 0
    whole = bytes_of(noisy)
    for name in whole:
        (noisy / name).unlink()
    for part in ("1-2", "3-3", "4-6x2", "5-5"):
        assert cli(*SHOT[:-1], part).code == 0
    assert bytes_of(noisy) == whole


def test_empty_and_truncated_outputs_are_rendered_again(noisy, cli):
    """Authority: the first run."""
    assert cli(*SHOT).code == 0
    whole = bytes_of(noisy)
    (noisy / "out.0002.png").write_bytes(b"")
    (noisy / "out.0003.png").write_bytes(whole["out.0003.png"][:-20])
    write_image(noisy / "out.0004.png", np.zeros((8, 8, 3), np.float32))
    outcome = cli(*SHOT)
    assert outcome.code == 0
    assert "3 frames rendered, 3 exist already" in outcome.err.replace(" with", ",")
    assert bytes_of(noisy) == whole


@pytest.mark.slow
def test_processes_and_later_runs_give_the_same_files(noisy, cli):
    assert cli(*SHOT).code == 0
    whole = bytes_of(noisy)
    assert len(set(whole.values())) > 1
    for name in ("out.0002.png", "out.0005.png"):
        (noisy / name).unlink()
    assert cli(*SHOT).code == 0
    assert bytes_of(noisy) == whole
    assert cli(*SHOT, "--overwrite", "--jobs", "2").code == 0
    assert bytes_of(noisy) == whole


def test_a_run_that_is_stopped_leaves_its_maps_to_the_next(noisy, cli, monkeypatch):
    assert cli(*SHOT).code == 0
    whole = bytes_of(noisy)
    for name in whole:
        (noisy / name).unlink()
    render, left = workers.render_frame, [2]

    def stopping(*arguments, **options):
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        return render(*arguments, **options)

    monkeypatch.setattr(workers, "render_frame", stopping)
    assert cli(*SHOT).code == 130
    assert len(bytes_of(noisy)) == 2
    assert hidden(noisy) == [".bokehnet-shot-out.0001.png-6"]
    monkeypatch.setattr(workers, "render_frame", render)

    def never(*arguments):
        raise AssertionError("was looked through again")

    monkeypatch.setattr(FilteredShot, "_filtered", never)
    assert cli(*SHOT).code == 0
    assert bytes_of(noisy) == whole
    assert hidden(noisy) == []


def test_maps_of_other_files_are_not_taken(noisy, cli, monkeypatch):
    monkeypatch.setattr(shot_files.shutil, "rmtree", lambda *arguments, **options: None)
    assert cli(*SHOT).code == 0
    before = bytes_of(noisy)
    monkeypatch.undo()
    monkeypatch.chdir(noisy)
    for frame in FRAMES:
        write_map(f"z.{frame:04d}.exr", np.full((64, 96), 0.5, np.float32))
    assert cli(*SHOT, "--overwrite").code == 0
    assert not set(bytes_of(noisy).values()) & set(before.values())


def test_a_frame_that_cannot_be_read_fails_alone(noisy, cli):
    (noisy / "in.0002.png").unlink()
    (noisy / "z.0004.exr").write_bytes(b"no map")
    write_image("in.0005.png", np.zeros((32, 40, 3), np.float32))  # of another size than its map
    outcome = cli(*SHOT)
    assert outcome.code == 1
    assert "3 of 6 frames failed: 2,4-5" in outcome.err
    assert set(bytes_of(noisy)) == {f"out.000{frame}.png" for frame in (1, 3, 6)}
    assert hidden(noisy) != []  # for the same command, which tries them again
    assert "Traceback" not in outcome.err


def test_a_shot_whose_size_changes_is_two(noisy, cli):
    for frame in (4, 5, 6):
        write_image(f"in.{frame:04d}.png", np.full((48, 80, 3), 0.3 * frame - 1, np.float32))
        write_map(f"z.{frame:04d}.exr", np.full((48, 80), 0.1 * frame, np.float32))
    assert cli(*SHOT, "--save-maps", "maps").code == 0
    for frame in (4, 5, 6):
        np.testing.assert_allclose(
            read_map(f"maps/{frame:04d}/defocus.exr"), 8 * (0.1 * frame - 0.3), atol=0.3
        )
    assert read_map("maps/0003/defocus.exr").shape == (64, 96)


def test_exact_maps_and_stills_are_no_shot_to_keep(noisy, cli, monkeypatch):
    def never(*arguments, **options):
        raise AssertionError("a folder was asked for")

    monkeypatch.setattr(shot_files, "exclusive_folder", never)
    words = ["-o", "out.####.png", "--engine", "scatter", "--frames", "1-3", "--repair-disparity", "off"]
    for frame in (1, 2, 3):
        write_map(f"m.{frame:04d}.exr", (2 + frame * TRUTH).astype(np.float32), channel="Z")
    lens = ["--focal-length", "50", "--f-number", "2", "--sensor-width", "36", "--focus-distance", "3"]
    assert cli("render", "in.####.png", "--depth", "m.####.exr", *lens, *words).code == 0
    blur = ["--blur", "8", "--focus", "0.3", "--overwrite"]
    assert cli("render", "in.####.png", "--disparity", "z.0001.exr", *blur, *words).code == 0


def test_a_shot_that_another_process_has_gets_a_folder_of_its_own(noisy, cli):
    from bokehnet.sequence.resumable_folder import exclusive_folder

    with exclusive_folder(noisy / ".bokehnet-shot-out.0001.png-6") as held:
        assert cli(*SHOT).code == 0
        assert hidden(noisy) == [held.name]
    assert len(bytes_of(noisy)) == 6


def test_a_full_disk_is_reported_in_one_line(noisy, cli, monkeypatch):
    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("bokehnet.sequence.filtered_shot.np.save", full)
    outcome = cli(*SHOT, "--quiet")
    assert outcome.code == 1
    assert "steady maps cannot be stored there: No space left on device" in outcome.err
    assert outcome.err.count("\n") == 1
    assert bytes_of(noisy) == {}


def test_files_and_videos_share_what_decides():
    assert workers.decided_jobs.__module__ == "bokehnet.cli.render.shot.shot_files"
    assert shot_files.analyse_shot is shot_module.analyse_shot
    assert VideoJob.run.__globals__["analyse_shot"] is shot_module.analyse_shot


def test_pictures_of_a_steady_shot_change_less_than_those_of_its_maps(noisy, cli):
    def change():
        shown = np.stack([read_image(f"out.{frame:04d}.png") for frame in FRAMES])
        return float(np.abs(np.diff(shown, axis=0)).mean())

    assert cli(*SHOT, "--dither", "off").code == 0
    steady = change()
    assert cli(*SHOT, "--dither", "off", "--overwrite", "--steady", "off").code == 0
    assert steady < 0.2 * change()
    assert_array_equal(read_image("in.0001.png"), read_image("in.0006.png"))

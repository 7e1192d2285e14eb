"""Frames of a shot on a cluster of this machine. Authority: the bytes that one process writes."""

import threading
from pathlib import Path

import numpy as np
import pytest

from bokehnet.cli.render.frame import FrameJob
from bokehnet.cli.render.shot.cluster_frames import _absolute
from bokehnet.io.image import write_image, write_map
from bokehnet.settings.settings import RenderSettings

FRAMES = 10
OPTIONS = [
    "--disparity",
    "d.png",
    "--blur-from",
    "8",
    "--blur-to",
    "30",
    "--focus",
    "0.5",
    "--frames",
    f"1-{FRAMES}",
]


@pytest.fixture
def shot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    for frame in range(1, FRAMES + 1):
        write_image(f"in.{frame:04}.png", rng.random((120, 160, 3), dtype=np.float32))
    write_map("d.png", np.tile(np.linspace(0, 1, 160, dtype=np.float32), (120, 1)))
    return tmp_path


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_shot_on_a_cluster_is_that_of_one_machine_though_a_worker_is_killed(cli, cluster, shot):
    worker = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    killed = threading.Event()

    def kill():
        while not (shot / "ray.0001.png").exists():
            if killed.wait(0.05):
                return
        cluster.remove_node(worker, allow_graceful=False)
        killed.set()

    thread = threading.Thread(target=kill)
    thread.start()
    outcome = cli("render", "in.####.png", "-o", "ray.####.png", *OPTIONS, "--ray", cluster.address)
    was_killed = killed.is_set()
    killed.set()
    thread.join()
    assert outcome.code == 0, outcome.err
    assert was_killed
    assert cli("render", "in.####.png", "-o", "one.####.png", *OPTIONS).code == 0
    for frame in range(1, FRAMES + 1):
        assert (shot / f"ray.{frame:04}.png").read_bytes() == (shot / f"one.{frame:04}.png").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--ray", "127.0.0.1:1"], ["--ray: expected the address of a running cluster", "127.0.0.1:1"]),
        (["--ray", "auto", "--jobs", "2"], ["--ray: expected either this or --jobs"]),
    ],
)
def test_an_impossible_cluster_is_reported_in_one_line(cli, shot, options, words):
    pytest.importorskip("ray", reason="needs the extra cluster")
    outcome = cli("render", "in.####.png", "-o", "ray.####.png", *OPTIONS, *options)
    assert outcome.code == 1
    for word in words:
        assert word in outcome.err
    assert not list(shot.glob("ray.*"))


def test_paths_of_every_group_are_named_from_the_root(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("weights", "d.png", "own.toml", "heart.png"):
        (tmp_path / name).touch()
    settings = RenderSettings().updated(
        {
            "input": {"disparity": "d.png"},
            "engine": {"weights": "weights"},
            "aperture": {"image": "heart.png"},
            "lens": {"name": "own.toml"},
            "output": {"save_maps": "maps"},
        }
    )
    job = FrameJob(image=Path("in.png"), output=Path("out.png"), settings=settings)
    result = _absolute(job)
    paths = [result.image, result.output, result.settings.input.disparity, result.settings.engine.weights]
    paths += [result.settings.aperture.image, result.settings.output.save_maps]
    assert paths == [tmp_path / n for n in ("in.png", "out.png", "d.png", "weights", "heart.png", "maps")]
    assert result.settings.lens.name == str(tmp_path / "own.toml")


def test_names_that_are_no_files_stay():
    settings = RenderSettings().updated({"lens": {"name": "petzval"}, "engine": {"name": "rays"}})
    job = FrameJob(image=Path("in.png"), output=Path("out.png"), settings=settings)
    assert _absolute(job).settings == settings

"""``bokehnet trace``: its methods, tiles and samples of pixels' own number."""

import threading

import numpy as np
import pytest

from bokehnet.io.channels import read_channels

pytest.importorskip("torch", reason="rays are traced with the extra trace")


def test_accumulation_goes_on_from_the_views_in_the_file(cli, scene, tmp_path):
    part, whole, other = (tmp_path / name for name in ("part.exr", "whole.exr", "other.exr"))
    accumulate = ("trace", scene, "--method", "accumulation", "-o")
    assert cli(*accumulate, part, "--views", 3).code == 0
    assert cli(*accumulate, part, "--views", 6).code == 0
    assert cli(*accumulate, whole, "--views", 6).code == 0
    assert part.read_bytes() == whole.read_bytes()
    assert cli("trace", scene, "-o", other, "--samples", 6).code == 0
    pictures = [read_channels(path).channels["R"] for path in (whole, other)]
    assert not np.array_equal(*pictures)
    assert np.abs(pictures[0] - pictures[1]).mean() < 0.05
    outcome = cli("trace", scene, "-o", whole, "--samples", 9)
    assert outcome.code == 1
    assert "is not of this scene" in outcome.err


def test_tiles_are_the_picture(cli, scene, tmp_path):
    """Authority: the bytes of the picture traced at once; rounds of 64 samples, and one that is begun."""
    for name, options in (("whole", ()), ("tiles", ("--tiles", 5)), ("rows", ("--tiles", 16))):
        assert cli("trace", scene, "-o", tmp_path / f"{name}.exr", "--samples", 70, *options).code == 0
    whole, *others = ((tmp_path / f"{name}.exr").read_bytes() for name in ("whole", "tiles", "rows"))
    assert all(other == whole for other in others)


def test_peeled_is_the_method_of_layers(cli, scene, tmp_path):
    assert cli("trace", scene, "-o", tmp_path / "a.exr", "--method", "peeled").code == 0
    assert cli("trace", scene, "-o", tmp_path / "b.exr", "--layers", 6).code == 0
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_adaptive_films_report_their_samples_and_resume(cli, scene, tmp_path):
    for samples in (20, 40):
        assert cli("trace", scene, "-o", tmp_path / "a.exr", "--adaptive", "--samples", samples).code == 0
    assert cli("trace", scene, "-o", tmp_path / "b.exr", "--adaptive", "--samples", 40).code == 0
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    counts = read_channels(tmp_path / "a.exr").channels["samples"]
    assert counts.mean() == pytest.approx(40, abs=1)
    assert counts.min() >= 16
    assert counts.max() > 60


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--method", "views"), "--method: expected"),
        (("--views", 3), "--views: expected --method accumulation, got --method distribution"),
        (("--views", 0, "--method", "accumulation"), "Invalid value for '--views'"),
        (("--method", "accumulation", "--views", 3, "--samples", 3), "--views: expected either this or"),
        (("--method", "accumulation", "--layers", 3), "--layers: expected --method peeled"),
        (("--method", "accumulation", "--adaptive"), "--adaptive: expected --method distribution"),
        (
            ("--adaptive", "--tiles", 2),
            "--tiles: expected the same number of samples in all pixels, got --adaptive",
        ),
        (("--layers", 2, "--ray", "auto"), "--ray: expected the same number of samples in all pixels"),
        (("--tiles", 17), "--tiles: expected at most the 16 rows of the picture, got 17"),
    ],
)
def test_what_does_not_go_together_is_one_line(cli, scene, tmp_path, options, message):
    outcome = cli("trace", scene, "-o", tmp_path / "a.exr", *options)
    assert outcome.code != 0
    assert message in outcome.err
    assert not (tmp_path / "a.exr").exists()


def test_no_cluster_there_is_one_line(cli, scene, tmp_path):
    pytest.importorskip("ray", reason="needs the extra cluster")
    outcome = cli("trace", scene, "-o", tmp_path / "a.exr", "--ray", "127.0.0.1:1")
    assert outcome.code == 1
    assert "--ray: expected the address of a running cluster" in outcome.err
    assert not (tmp_path / "a.exr").exists()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_picture_on_a_cluster_is_that_of_one_process_though_a_worker_is_killed(
    cli, cluster, scene, tmp_path, monkeypatch
):
    worker = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    from bokehnet.cli.trace import cluster_tiles

    killed, arrived = threading.Event(), threading.Event()

    def kill():
        arrived.wait()
        cluster.remove_node(worker, allow_graceful=False)
        killed.set()

    threading.Thread(target=kill, daemon=True).start()
    connected = cluster_tiles.tiles_on_cluster

    def watched(address):
        import contextlib

        @contextlib.contextmanager
        def tiles():
            with connected(address) as run:

                def reported(tasks):
                    for result in run(tasks):
                        arrived.set()
                        yield result

                yield reported

        return tiles()

    monkeypatch.setattr(cluster_tiles, "tiles_on_cluster", watched)
    size = ("--width", 96, "--height", 64, "--samples", 192)
    outcome = cli("trace", scene, "-o", tmp_path / "ray.exr", *size, "--ray", cluster.address, "--tiles", 16)
    assert outcome.code == 0, outcome.err
    assert killed.wait(60)
    assert cli("trace", scene, "-o", tmp_path / "one.exr", *size).code == 0
    assert (tmp_path / "ray.exr").read_bytes() == (tmp_path / "one.exr").read_bytes()

"""Forked children read and write pictures after their parent did. Authority: the parent's own files."""

import os
import signal
import threading

import numpy as np
import pytest

from bokehnet.io.image import read_image, write_image

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
EXTENSIONS = ("exr", "tif", "png", "jpg")
MAX_SECONDS = 60


def in_child(call):
    """Return the exit status of a forked child that runs ``call``; a hang ends by a signal."""
    child = os.fork()
    if child == 0:
        signal.alarm(MAX_SECONDS)
        code = 1
        try:
            call()
            code = 0
        finally:
            os._exit(code)
    return os.waitpid(child, 0)[1]


@pytest.fixture
def image():
    return np.random.default_rng(0).random((400, 300, 3), dtype=np.float32)


@pytest.mark.parametrize("first", EXTENSIONS)
def test_children_write_what_their_parent_writes(tmp_path, image, first):
    write_image(tmp_path / f"parent.{first}", image)
    for extension in EXTENSIONS:
        write_image(tmp_path / f"expected.{extension}", image)
        assert in_child(lambda e=extension: write_image(tmp_path / f"child.{e}", image)) == 0, extension
        assert (tmp_path / f"child.{extension}").read_bytes() == (
            tmp_path / f"expected.{extension}"
        ).read_bytes()
        assert in_child(lambda e=extension: read_image(tmp_path / f"child.{e}")) == 0, extension
    write_image(tmp_path / "after.exr", image)  # the parent goes on


def test_a_parent_may_fork_while_it_writes(tmp_path, image):
    stop = threading.Event()

    def write():
        while not stop.is_set():
            write_image(tmp_path / "busy.exr", image)

    thread = threading.Thread(target=write)
    thread.start()
    try:
        for number in range(5):
            assert in_child(lambda n=number: write_image(tmp_path / f"child{n}.exr", image)) == 0
    finally:
        stop.set()
        thread.join()
    write_image(tmp_path / "last.exr", image)


@pytest.mark.slow
def test_children_render_exr_to_exr_as_their_parent_did(tmp_path, image):
    """Rendering starts further pools; the result replaces channels of the open source."""
    from bokehnet import BokehRenderer, RenderSettings, read_scene
    from bokehnet.io.channels import write_channels

    planes = dict(zip("RGB", image[:40, :60].transpose(2, 0, 1), strict=True))
    write_channels(tmp_path / "in.exr", planes | {"Z": planes["R"] + 1})
    camera = {"focal_length": 50, "f_number": 2, "sensor_width": 36}
    table = {"camera": camera, "focus": {"distance": 3}, "input": {"depth": str(tmp_path / "in.exr")}}
    settings = RenderSettings().updated(table)

    def job(name):
        scene = read_scene(tmp_path / "in.exr", settings)
        BokehRenderer().render(scene, settings).save(tmp_path / name)

    job("parent.exr")
    for number in range(3):
        assert in_child(lambda n=number: job(f"child{n}.exr")) == 0
        assert (tmp_path / f"child{number}.exr").read_bytes() == (tmp_path / "parent.exr").read_bytes()

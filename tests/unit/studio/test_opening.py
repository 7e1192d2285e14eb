"""Order of work at the opening of a picture: users wait for it, tables of shapes do not."""

import os
import sys
import threading
import time

import numpy as np
import pytest

from bokehnet.errors import ShapeError
from bokehnet.io.image import write_image, write_map
from bokehnet.render.look import make_aperture
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.subject import find_subject
from bokehnet.settings.settings import RenderSettings
from bokehnet.studio.background import BackgroundProcess
from bokehnet.studio.opened import MAX_PIXELS, Opened, open_picture
from bokehnet.studio.preview import preview
from bokehnet.studio.preview.preview import Canvas, Previews
from tests.unit.studio.conftest import SIZE


@pytest.fixture
def own_limit(monkeypatch):
    """The limit of pixels, which `open_picture` sets for its process, ends with the test."""
    monkeypatch.setenv(*MAX_PIXELS)


def process_facts(module, report):
    """Return niceness of the process, and whether it has imported a module."""
    return os.nice(0), module in sys.modules


@pytest.mark.skipif(not hasattr(os, "nice"), reason="needs POSIX priorities")
def test_a_picture_opens_at_normal_priority_unless_an_export_runs(session, files, monkeypatch):
    tasks = []
    for name in ("slow", "exporter"):
        process = getattr(session, name)

        def run(task, *arguments, name=name, run=process.run, **named):
            tasks.append((name, task.__name__))
            return run(task, *arguments, **named)

        monkeypatch.setattr(process, "run", run)
    settings = RenderSettings().updated({"depth": {"repair": "off"}})
    for state, name in (("idle", "exporter"), ("running", "slow")):
        session.jobs["export"] = {"state": state}
        session.open(files / "photo.png", settings)
        assert [task for task in tasks if task[1] == "open_picture"] == [(name, "open_picture")]
        tasks.clear()
    session.jobs["export"] = {"state": "idle"}
    assert session.exporter.run(process_facts, "bokehnet.studio.opened") == (os.nice(0), True)


def test_a_process_imports_the_modules_of_its_tasks_at_its_start():
    process = BackgroundProcess(0, modules=("colorsys",))
    try:
        assert process.run(process_facts, "colorsys")[1]
    finally:
        process.stop()


def test_tables_of_shapes_wait_for_the_first_picture(opened, monkeypatch):
    prepared = threading.Event()
    shape = RenderSettings().updated({"aperture": {"blades": 7, "rotation": 11}}).aperture

    def prepare(aperture, largest):  # previews of earlier tests may still prepare theirs
        if aperture == make_aperture(shape):
            prepared.set()

    monkeypatch.setattr(preview, "prepare_tables", prepare)
    previews = Previews(opened.fine)
    previews.prepare_shapes([shape])
    time.sleep(0.3)
    assert not prepared.is_set()
    canvas, signal = Canvas(size=SIZE, space="srgb"), threading.Event()
    stages = previews.stages(opened.opened, opened.settings, canvas, signal, lambda done, total: None)
    assert [picture.stage for picture in stages][-1] == "final"
    assert prepared.wait(5)
    previews.close()


def test_the_first_look_has_the_blur_of_the_command_line(own_limit, tmp_path):
    """Authority: the prepared scene of a render without options of the look."""
    disparity = np.full((64, 96), 0.2, np.float32)
    disparity[16:52, 30:64] = 0.7
    disparity[0, 0], disparity[0, 1] = 0.0, 1.0
    write_image(tmp_path / "photo.png", np.full((64, 96, 3), 0.3, np.float32) + 0.3 * disparity[..., None])
    write_map(tmp_path / "map.png", disparity)
    changes = {"input": {"disparity": str(tmp_path / "map.png")}, "depth": {"repair": "off"}}
    settings = RenderSettings().updated(changes)
    scene, _, completed = open_picture(tmp_path / "photo.png", settings, report=lambda done, total: None)
    renderer = BokehRenderer()
    first, command = (renderer.prepare(scene, each) for each in (completed, settings))
    assert np.abs(first.defocus).max() == pytest.approx(np.abs(command.defocus).max(), abs=0.1)
    assert np.abs(command.defocus).max() > 2


@pytest.mark.parametrize("is_changed", [False, True])
def test_the_default_focus_follows_the_repaired_map(own_limit, files, is_changed):
    """Authority: the subject, a flat square, in the new map; settings that the user has changed stay."""
    settings = RenderSettings().updated({"input": {"disparity": str(files / "map.png")}})
    scene, asked, complete = open_picture(files / "photo.png", settings, report=lambda done, total: None)
    opened = Opened(files / "photo.png", scene, asked, complete)
    current = complete.updated({"camera": {"blur": 7}}) if is_changed else complete
    opened.take_repaired((0.8 * scene.depth.values).astype(np.float32), True, "test")
    near = find_subject(scene.image, opened.values).near
    assert abs(complete.focus.value - near) > 0.1
    expected = complete.focus.value if is_changed else near
    assert opened.refocused(current).focus.value == pytest.approx(expected)


@pytest.mark.parametrize(("width", "height", "fits"), [(48, 32, True), (49, 32, True), (48, 64, False)])
def test_a_map_of_another_shape_is_refused(own_limit, files, tmp_path, width, height, fits):
    write_map(tmp_path / "map.png", np.tile(np.linspace(0, 1, width, dtype=np.float32), (height, 1)))
    settings = RenderSettings().updated({"input": {"disparity": str(tmp_path / "map.png")}})
    words = (files / "photo.png", settings)
    if fits:
        scene, *_ = open_picture(*words, report=lambda done, total: None)
        assert scene.depth.values.shape == scene.image.shape[:2]
        return
    with pytest.raises(ShapeError, match=r"48x64 pixels, the picture 96x64.*of this picture"):
        open_picture(*words, report=lambda done, total: None)

"""Order of work at the opening of a picture: users wait for it, tables of shapes do not."""

import os
import sys
import threading
import time

import pytest

from bokehnet.render.look import make_aperture
from bokehnet.settings.settings import RenderSettings
from bokehnet.studio.background import BackgroundProcess
from bokehnet.studio.preview import preview
from bokehnet.studio.preview.preview import Canvas, Previews
from tests.unit.studio.conftest import SIZE


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

"""A bound of the memory that is too small is told before anything is read."""

import re

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.io.image import write_image, write_map
from bokehnet.rendering import scene as scene_module
from bokehnet.rendering.memory import PROGRAM, least_memory
from bokehnet.rendering.scene import read_scene
from bokehnet.rendering.settings import RenderSettings

TOLD = {"input": {"disparity": "map.png"}, "camera": {"blur": 20}, "focus": {"value": 0.25}}


def bounded(size: int, **others: object) -> RenderSettings:
    return RenderSettings().updated({**TOLD, "engine": {"max_memory": size}, **others})


def test_it_is_refused_before_the_pixels_are_read_and_the_least_is_enough(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_image("photo.png", np.full((40, 60, 3), 0.5, np.float32))
    write_map("map.png", np.linspace(0, 1, 2400).reshape(40, 60))
    read = []
    kept = scene_module.read_frame
    monkeypatch.setattr(scene_module, "read_frame", lambda path, told: read.append(path) or kept(path, told))
    with pytest.raises(ParameterError, match=r"engine.max_memory: expected at least \d+ MB") as told:
        read_scene("photo.png", bounded(10**8))
    assert not read
    found = re.search(r"at least (\d+) MB for 60x40 pixels", str(told.value))
    assert found is not None
    assert read_scene("photo.png", bounded(int(found[1]) * 10**6)).image.shape == (40, 60, 3)


def test_the_least_grows_with_the_picture_and_with_what_is_asked_for():
    settings = bounded(10**9, depth={"repair": "off"})
    small, large = (least_memory(settings, "rays", 1000 * n, 1000 * n) for n in (1, 5))
    assert PROGRAM < small < large
    assert least_memory(settings, "scatter", 5000, 5000) < large
    assert least_memory(bounded(10**9), "scatter", 5000, 5000) > least_memory(settings, "scatter", 5000, 5000)
    wide = settings.updated({"camera": {"blur": 400}})
    assert least_memory(wide, "rays", 5000, 5000) > large

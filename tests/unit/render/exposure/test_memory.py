"""A memory bound that is too small is reported before anything is read."""

import re
from dataclasses import replace

import numpy as np
import pytest

from bokehnet import BokehRenderer
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ParameterError
from bokehnet.io.image import write_image, write_map
from bokehnet.io.window import Window
from bokehnet.render.exposure.memory_bounds import PROGRAM, check_memory, min_memory
from bokehnet.render.look import make_lens_response, picture_aberrations
from bokehnet.scene import scene as scene_module
from bokehnet.scene.focus import FocusedLens
from bokehnet.scene.scene import read_scene
from bokehnet.settings.settings import RenderSettings
from tests.unit.io.exr.exr_files import write_exr

TOLD = {"input": {"disparity": "map.png"}, "camera": {"blur": 20}, "focus": {"value": 0.25}}


def bounded(size: int, **others: object) -> RenderSettings:
    return RenderSettings().updated({**TOLD, "engine": {"max_memory": size}, **others})


def test_the_minimum_that_is_stated_is_enough(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_image("photo.png", np.full((40, 60, 3), 0.5, np.float32))
    write_map("map.png", np.linspace(0, 1, 2400).reshape(40, 60))
    with pytest.raises(ParameterError, match=r"engine.max_memory: expected at least \d+ MB") as error:
        check_memory("photo.png", bounded(10**8))
    match = re.search(r"at least (\d+) MB for 60x40 pixels", str(error.value))
    assert match is not None
    settings = bounded(int(match[1]) * 10**6)
    check_memory("photo.png", settings)
    result = BokehRenderer("rays").render(read_scene("photo.png", settings), settings)
    assert result.bokeh.shape == (40, 60, 3)


def test_commands_check_memory_before_they_read_the_pixels(tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    write_image("photo.png", np.full((40, 60, 3), 0.5, np.float32))
    write_map("map.png", np.linspace(0, 1, 2400).reshape(40, 60))
    read = []
    monkeypatch.setattr(scene_module, "read_frame", lambda *arguments: read.append(arguments))
    words = ("photo.png", "--disparity", "map.png", "--blur", 20, "--focus", 0.25, "--max-memory", "100M")
    outcome = cli("render", *words, "-o", "out.png")
    assert outcome.code == 1
    assert "--max-memory: expected at least" in outcome.err
    assert not read


def test_the_minimum_grows_with_the_picture_and_the_request():
    settings = bounded(10**9, depth={"repair": "off"})
    small, large = (min_memory(settings, "rays", 1000 * n, 1000 * n) for n in (1, 5))
    assert PROGRAM < small < large
    assert min_memory(settings, "scatter", 5000, 5000) < min_memory(settings, "hybrid", 5000, 5000)
    repaired = [min_memory(bounded(10**9), "scatter", size, size) for size in (1000, 5000)]
    rendered = [min_memory(settings, "scatter", size, size) for size in (1000, 5000)]
    assert repaired[0] == rendered[0]  # the repair of a small picture takes less than its render
    assert repaired[1] > rendered[1]
    wide = settings.updated({"camera": {"blur": 400}})
    assert min_memory(wide, "rays", 5000, 5000) > large


@pytest.mark.parametrize(
    "look",
    [
        {"lens": {"name": "double_gauss"}},
        {"lens": {"spherical": 0.8, "coma": 30}},
        {"color": {"axial": 0.8, "lateral": 4.0}},
        {},
    ],
)
def test_what_a_lens_sends_farther_is_counted_before_anything_is_read(look):
    """Authority: the minimum that the engine itself reports once the picture is there, of 400x3000 pixels."""
    settings = bounded(1, depth={"repair": "off"}, **look)
    height, width = 3000, 400
    least = min_memory(settings, "rays", width, height)
    engine = Engine("rays")
    defocus = np.full((height, width), -15, np.float32)
    defocus[0, 0] = 5
    response = make_lens_response(settings.lens, settings.color)
    window = Window.whole(width, height)
    focused = FocusedLens(near=0.25, far=0.25, blur=20, camera=None, plane=None, window=window)
    glass = picture_aberrations(settings.lens, focused, window)
    if glass is not None:
        response = replace(response, aberration_map=response.aberration_map + glass)
    selected = PROGRAM + 16 * height * width
    with pytest.raises(ParameterError) as error:
        engine.render(
            np.ones((height, width, 3), np.float32),
            defocus,
            options=RenderOptions(lens_response=response, max_memory=selected, memory_in_use=selected),
        )
    match = re.search(r"at least (\d+) MB", str(error.value))
    assert match is not None
    assert int(match[1]) == np.ceil(least / 1e6)


@pytest.mark.parametrize("engine", ["scatter", "rays"])
def test_alpha_is_counted_before_anything_is_read(engine, tmp_path, monkeypatch):
    """The reported minimum is enough to render with; without alpha it is less."""
    monkeypatch.chdir(tmp_path)
    height, width = 1500, 60
    rgba = np.full((height, width, 4), 0.25, np.float32)
    rgba[700:, :, 3] = 0.5
    write_exr("shot.exr", {"channels": {name: ("float", rgba[..., i]) for i, name in enumerate("RGBA")}})
    write_map("map.png", np.linspace(0, 1, height * width).reshape(height, width))

    def bounded_to(size):
        return bounded(size, depth={"repair": "off", "as_stored": True}).updated({"engine": {"name": engine}})

    with pytest.raises(ParameterError, match=r"at least \d+ MB") as refused:
        check_memory("shot.exr", bounded_to(10**8))
    match = re.search(r"at least (\d+) MB", str(refused.value))
    assert match is not None
    settings = bounded_to(int(match[1]) * 10**6)
    assert BokehRenderer().render(read_scene("shot.exr", settings), settings).alpha.shape == (height, width)
    assert min_memory(settings, engine, width, height) < min_memory(settings, engine, width, height, True)


def test_the_bound_covers_reading(tmp_path):
    """A deep EXR whose samples need more memory than the small picture itself, and a large map."""
    from tests.unit.io.test_bounds import deep_exr, png

    (tmp_path / "deep.exr").write_bytes(deep_exr(60_000, 60))
    settings = RenderSettings().updated({"engine": {"name": "scatter", "max_memory": 300 * 10**6}})
    with pytest.raises(ParameterError, match=r"at least .* MB"):
        check_memory(tmp_path / "deep.exr", settings)
    write_image(tmp_path / "a.png", np.zeros((8, 8, 3), np.float32))
    (tmp_path / "map.png").write_bytes(png(9000, 7000))
    table = {"engine": {"name": "scatter", "max_memory": 900 * 10**6}, "input": {}}
    check_memory(tmp_path / "a.png", RenderSettings().updated(table))
    table["input"] = {"disparity": str(tmp_path / "map.png")}
    with pytest.raises(ParameterError, match=r"reading .*map.png"):
        check_memory(tmp_path / "a.png", RenderSettings().updated(table))

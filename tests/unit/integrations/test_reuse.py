"""Programs that render a picture again with another focus repair its map once. Authority: fresh renders."""

import importlib.util
import io
import json
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.io.image import read_image, write_image, write_map
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import RelativeDisparity
from bokehnet.scene.scene import make_scene
from bokehnet.settings.settings import RenderSettings
from tests.unit.conftest import HEIGHT, WIDTH, displaced_card

PACK = Path(__file__).parents[3] / "integrations/comfyui"
ENGINE = {"engine": {"name": "scatter"}, "camera": {"blur": 12}}


@pytest.fixture
def picture():
    """Picture and map of a card in front of a texture; the map lies four pixels beside the card."""
    return displaced_card()


@pytest.fixture
def files(picture, tmp_path):
    """Write image.png and disparity.png to a folder."""
    write_image(tmp_path / "image.png", picture[0])
    write_map(tmp_path / "disparity.png", picture[1])
    return tmp_path


def test_the_notebook_widget_repairs_once(picture, repairs):
    pytest.importorskip("anywidget", reason="needs the extra notebook")
    from bokehnet.integrations.notebook import FocusWidget

    scene = make_scene(picture[0], RelativeDisparity(map=picture[1]))
    widget = FocusWidget(scene, RenderSettings().updated({"camera": {"blur": 12}}))
    for clicked in ([0.1, 0.1], [0.5, 0.5], [0.9, 0.2]):
        widget.clicked = clicked
        assert widget.result is not None, widget.line
    assert len(repairs) == 1
    pixel = {"focus": {"at": (int(0.9 * WIDTH), int(0.2 * HEIGHT))}}
    fresh = BokehRenderer(cache_bytes=0).render(scene, RenderSettings().updated({**ENGINE, **pixel}))
    assert_array_equal(widget.result.bokeh, fresh.bokeh)


def test_a_worker_of_the_service_repairs_once(files, repairs):
    pytest.importorskip("prometheus_client", reason="needs the extra serve")
    from bokehnet.serve.jobs.worker import _outcome
    from bokehnet.serve.requests import check_request

    class Pipe:
        def poll(self):
            return False

        def send(self, message):
            pass

    names = {"image": "image.png", "disparity": "disparity.png"}
    renderer = BokehRenderer()
    for job, focus in enumerate((0.2, 0.8, 0.2)):
        table = {**ENGINE, "focus": {"value": focus}, "highlights": {"threshold": 0.5}}
        request = {**check_request(json.dumps(table), None, "png", names), "memory": 2 * 2**30}
        (files / "request.json").write_text(json.dumps(request))
        outcome = _outcome(Pipe(), renderer, files, f"result{job}", 10**6)
        assert outcome["state"] == "done", outcome
    assert len(repairs) == 1
    first, second, third = (read_image(files / f"result{job}.png") for job in range(3))
    assert_array_equal(first, third)
    assert np.abs(first - second).max() > 0.01


def test_a_warm_renderer_repairs_once(files, repairs):
    from bokehnet.integrations.warm import WarmRenderer

    lines = []
    for number, focus in enumerate((0.2, 0.8)):
        settings = {**ENGINE, "focus": {"value": focus}, "input": {"disparity": str(files / "disparity.png")}}
        output, picture = str(files / f"{number}.png"), str(files / "image.png")
        lines.append(json.dumps({"id": number, "picture": picture, "settings": settings, "output": output}))
    responses = io.StringIO()
    WarmRenderer(responses).process(lines)
    assert responses.getvalue().count('"result"') == 2, responses.getvalue()
    assert len(repairs) == 1


@pytest.fixture
def nodes(monkeypatch):
    """Load the nodes of ComfyUI beside stand-ins for its two modules."""
    pytest.importorskip("torch", reason="ComfyUI's pictures are tensors")
    comfy, management, utils = (
        types.ModuleType(name) for name in ("comfy", "comfy.model_management", "comfy.utils")
    )
    management.processing_interrupted = lambda: False
    management.throw_exception_if_processing_interrupted = lambda: None
    utils.ProgressBar = lambda total: types.SimpleNamespace(update_absolute=lambda *arguments: None)
    comfy.model_management, comfy.utils = management, utils
    for module in (comfy, management, utils):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    package = types.ModuleType("comfy_pack")
    package.__path__ = [str(PACK)]
    monkeypatch.setitem(sys.modules, "comfy_pack", package)
    spec = importlib.util.spec_from_file_location("comfy_pack.render_nodes", PACK / "render_nodes.py")
    module = importlib.util.module_from_spec(spec)
    for name in ("comfy_pack.host", "comfy_pack.render_nodes"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "comfy_pack.render_nodes", module)
    spec.loader.exec_module(module)
    yield module
    for name in [name for name in sys.modules if name.startswith("comfy_pack")]:
        monkeypatch.delitem(sys.modules, name)


@pytest.mark.slow
def test_comfyui_nodes_repair_once(picture, repairs, nodes):
    import torch

    common = {
        "image": torch.from_numpy(picture[0])[None],
        "disparity": torch.from_numpy(picture[1])[None],
        "blur": 12.0,
        "engine": "scatter",
        "repair": "auto",
        "invert": False,
    }
    first, second = nodes.BokehRender(), nodes.BokehRender()
    pictures = [
        node.render(focus, **common)[0] for node, focus in ((first, 0.2), (first, 0.8), (second, 0.2))
    ]
    assert len(repairs) == 1
    assert torch.equal(pictures[0], pictures[2])
    assert not torch.equal(pictures[0], pictures[1])

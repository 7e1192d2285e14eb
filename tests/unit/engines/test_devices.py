"""Where an engine computes; a machine without a CUDA device, which is where most tests run."""

import importlib

import numpy as np
import pytest

from bokehnet.cli.app import run
from bokehnet.engines import devices
from bokehnet.engines.devices import device_of, providers_on
from bokehnet.engines.engine import Engine
from bokehnet.errors import MissingExtraError, ParameterError
from bokehnet.io.image import write_image, write_map
from bokehnet.render.renderer import BokehRenderer
from bokehnet.settings.settings import RenderSettings


@pytest.fixture
def no_device(monkeypatch):
    """A torch that finds no device, whatever this machine has."""
    pytest.importorskip("torch", reason="needs the extra cuda")
    module = importlib.import_module("bokehnet.classical.torch.device_scatter")
    monkeypatch.setattr(module, "why_no_cuda", lambda: "a torch without CUDA")


def test_auto_is_the_cpu_where_there_is_no_device(no_device):
    assert Engine("scatter", device="auto").device == "cpu"
    image, radii = np.full((20, 24, 3), 0.5, np.float32), np.full((20, 24), 3, np.float32)
    wanted = Engine("rays").render(image, radii).bokeh
    assert (Engine("rays", device="auto").render(image, radii).bokeh == wanted).all()


@pytest.mark.parametrize("name", ["scatter", "rays", "hybrid"])
def test_cuda_without_a_device_is_one_line_with_the_way_out(no_device, name):
    with pytest.raises(ParameterError) as told:
        Engine(name, device="cuda")
    assert str(told.value) == (
        "engine.device: expected a usable CUDA device; found a torch without CUDA, got 'cuda'; "
        "use --device cpu, or auto, which selects it"
    )


def test_a_method_of_the_literature_knows_the_cpu_alone():
    with pytest.raises(ParameterError, match="expected cpu for jimenez"):
        device_of("cuda", "jimenez")


def test_without_the_extra_its_name_is_told(monkeypatch):
    monkeypatch.setattr(devices, "require_extra", _missing)
    with pytest.raises(MissingExtraError, match=r"pip install 'bokehnet\[cuda\]'"):
        device_of("cuda", "scatter")
    assert device_of("auto", "scatter") == "cpu"


def _missing(module: str, extra: str) -> None:
    raise MissingExtraError(f"this needs {module}: pip install 'bokehnet[{extra}]'")


def test_an_unknown_device_names_the_choices():
    with pytest.raises(ParameterError, match="expected one of auto, cpu, cuda, got 'gpu'"):
        device_of("gpu", "rays")


def test_the_setting_chooses_the_device(no_device):
    told = RenderSettings().updated({"engine": {"device": "cuda", "name": "scatter"}})
    with pytest.raises(ParameterError, match="CUDA device"):
        BokehRenderer().check(told)


def test_networks_stay_on_the_cpu_where_onnx_runtime_has_nothing_else(monkeypatch):
    class Runtime:
        @staticmethod
        def get_available_providers():
            return names

    monkeypatch.setattr(devices, "load_onnxruntime", Runtime)
    names = ["CPUExecutionProvider"]
    assert providers_on("cuda") == ("CPUExecutionProvider",)
    names = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    assert providers_on("cuda") == ("CUDAExecutionProvider", "CPUExecutionProvider")
    assert providers_on("cpu") == ("CPUExecutionProvider",)


def test_the_command_tells_it_in_one_line_and_writes_nothing(no_device, tmp_path, capsys):
    write_image(tmp_path / "photo.png", np.full((20, 24, 3), 0.5, np.float32))
    write_map(tmp_path / "map.png", np.tile(np.linspace(0, 1, 24, dtype=np.float32), (20, 1)))
    words = [
        "render",
        tmp_path / "photo.png",
        "--disparity",
        tmp_path / "map.png",
        "--blur",
        "4",
        "--focus",
        "0",
    ]
    code = run([*map(str, words), "--device", "cuda", "-o", str(tmp_path / "out.png")])
    told = capsys.readouterr().err.strip()
    assert code == 1
    assert "--device: expected a usable CUDA device; found a torch without CUDA" in told
    assert len(told.splitlines()) == 1
    assert not (tmp_path / "out.png").exists()

"""Selection of the device of an engine, mostly on a machine without a CUDA device."""

import importlib
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from bokehnet.cli.app import run
from bokehnet.engines import devices
from bokehnet.engines.devices import device_of, providers_on
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import MissingExtraError, ParameterError
from bokehnet.io.image import write_image, write_map
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.render.renderer import BokehRenderer
from bokehnet.settings.settings import RenderSettings


@pytest.fixture
def no_device(monkeypatch):
    """Make torch report no CUDA device on any machine."""
    pytest.importorskip("torch", reason="needs the extra cuda")
    module = importlib.import_module("bokehnet.classical.torch.device_scatter")
    monkeypatch.setattr(module, "cuda_unavailable_reason", lambda: "a torch without CUDA")


def test_auto_selects_the_cpu_without_a_device(no_device):
    assert Engine("scatter", device="auto").device == "cpu"
    image, radii = np.full((20, 24, 3), 0.5, np.float32), np.full((20, 24), 3, np.float32)
    expected = Engine("rays").render(image, radii).bokeh
    assert (Engine("rays", device="auto").render(image, radii).bokeh == expected).all()


@pytest.mark.parametrize("name", ["scatter", "rays", "hybrid"])
def test_cuda_without_a_device_raises_one_line_with_a_remedy(no_device, name):
    with pytest.raises(ParameterError) as error:
        Engine(name, device="cuda")
    assert str(error.value) == (
        "engine.device: expected a usable CUDA device; found a torch without CUDA, got 'cuda'; "
        "use --device cpu, or auto, which selects it"
    )


def test_a_failing_import_of_numba_cuda_is_the_reason(monkeypatch):
    """For example, numba-cuda 0.30 with NumPy 2.5 raises AttributeError."""
    pytest.importorskip("torch", reason="needs the extra cuda")
    scatter = importlib.import_module("bokehnet.classical.torch.device_scatter")
    monkeypatch.setattr(scatter, "cuda_unavailable_reason", lambda: None)

    def load(name: str):
        if name == "bokehnet.classical.cuda.march":
            raise AttributeError("module 'numpy' has no attribute 'row_stack'")
        return importlib.import_module(name)

    monkeypatch.setattr(devices, "import_module", load)
    assert device_of("auto", "rays") == "cpu"
    assert device_of("auto", "scatter") == "cuda"
    with pytest.raises(ParameterError, match=r"numba\.cuda that cannot be imported \(.*row_stack"):
        device_of("cuda", "rays")


def test_baselines_run_only_on_the_cpu():
    with pytest.raises(ParameterError, match="expected cpu for jimenez"):
        device_of("cuda", "jimenez")


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setattr(devices, "require_extra", _missing)
    with pytest.raises(MissingExtraError, match=r"pip install 'bokehnet\[cuda\]'"):
        device_of("cuda", "scatter")
    assert device_of("auto", "scatter") == "cpu"


def _missing(module: str, extra: str) -> None:
    raise MissingExtraError(f"this needs {module}: pip install 'bokehnet[{extra}]'")


def test_an_unknown_device_names_the_choices():
    with pytest.raises(ParameterError, match="expected one of auto, cpu, cuda, got 'gpu'"):
        device_of("gpu", "rays")


def test_the_setting_selects_the_device(no_device):
    error = RenderSettings().updated({"engine": {"device": "cuda", "name": "scatter"}})
    with pytest.raises(ParameterError, match="CUDA device"):
        BokehRenderer().check(error)


def test_networks_run_on_the_cpu_without_other_providers(monkeypatch):
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


def test_the_command_prints_one_line_and_writes_nothing(no_device, tmp_path, capsys):
    write_image(tmp_path / "photo.png", np.full((20, 24, 3), 0.5, np.float32))
    write_map(tmp_path / "map.png", np.tile(np.linspace(0, 1, 24, dtype=np.float32), (20, 1)))
    arguments = [
        "render",
        tmp_path / "photo.png",
        "--disparity",
        tmp_path / "map.png",
        "--blur",
        "4",
        "--focus",
        "0",
    ]
    code = run([*map(str, arguments), "--device", "cuda", "-o", str(tmp_path / "out.png")])
    error = capsys.readouterr().err.strip()
    assert code == 1
    assert "--device: expected a usable CUDA device; found a torch without CUDA" in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out.png").exists()


def _picture(height: int = 200, width: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Return noise and the defocus of a near square in front of a slope behind focus."""
    image = np.random.default_rng(0).random((height, width, 3), np.float32)
    radii = np.tile(np.linspace(-8, -2, width, dtype=np.float32), (height, 1))
    radii[60:120, 80:160] = 7
    return image, radii


needs_device = pytest.mark.skipif(device_of("auto", "rays") == "cpu", reason="needs a CUDA device")


@pytest.mark.gpu
@needs_device
@pytest.mark.parametrize("name", ["rays", "scatter", "hybrid", "fast", "neural"])
def test_every_engine_matches_the_cpu(name):
    """Authority: the same engine on the CPU."""
    on_device, image_and_radii = Engine(name, device="cuda"), _picture()
    assert on_device.device == "cuda"
    difference = on_device.render(*image_and_radii).bokeh - Engine(name).render(*image_and_radii).bokeh
    assert np.mean(difference.astype(float) ** 2) < 1e-6


@pytest.mark.gpu
@needs_device
def test_strips_and_threads_give_the_same_picture_on_a_device():
    engine, (image, radii) = Engine("rays", device="cuda"), _picture(1200, 300)
    whole, brighter = (engine.render(picture, radii).bokeh for picture in (image, 2 * image))
    strips = engine.render(image, radii, options=RenderOptions(max_memory=40_000_000)).bokeh
    assert np.abs(strips - whole).max() < 1e-3
    with ThreadPoolExecutor(2) as pool:
        futures = [pool.submit(engine.render, picture, radii) for picture in (image, 2 * image, image)]
        results = [future.result().bokeh for future in futures]
    assert (results[0] == whole).all()
    assert (results[2] == whole).all()
    assert (results[1] == brighter).all()


@pytest.mark.gpu
@needs_device
def test_an_aberrated_lens_is_refused_on_a_device():
    image, radii = _picture()
    lens = LensResponse(aberration_map=AberrationSliders(coma=8.0).aberration_map())
    with pytest.raises(ParameterError, match="expected cpu for a lens that does more than focus"):
        Engine("rays", device="cuda").render(image, radii, options=RenderOptions(lens_response=lens))
    expected = Engine("rays").render(image, radii, options=RenderOptions(lens_response=lens)).bokeh
    result = Engine("rays", device="auto").render(image, radii, options=RenderOptions(lens_response=lens))
    assert (result.bokeh == expected).all()

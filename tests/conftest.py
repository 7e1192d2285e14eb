import gc
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
import torch

ROOT = Path(__file__).resolve().parents[1]
SHARED = Path(os.environ.get("BOKEHNET_SHARED", ROOT.parent / "shared"))


gc.disable()  # while tests are collected: their imports make millions of objects, and none of them dies


def pytest_collection_finish() -> None:
    """Collect garbage again, save what was imported."""
    gc.freeze()
    gc.enable()


def pytest_unconfigure() -> None:
    """Let what was imported go."""
    gc.unfreeze()


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    """Small pictures: torch threads cost more than they give, above all on a busy machine."""
    torch.set_num_threads(1)


@dataclass(frozen=True)
class Outcome:
    """What a command line gave back."""

    code: int
    out: str
    err: str


@pytest.fixture(scope="session")
def shared() -> Callable[[str], Path]:
    """Find a file of the shared folder beside the repository; skip where it is absent."""

    def find(relative: str) -> Path:
        path = SHARED / relative
        if not path.exists():
            pytest.skip(f"needs {relative} of the shared folder beside the repository, which is not here")
        return path

    return find


@pytest.fixture
def cli(capfd: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Run the command line in this process; C libraries that write to stderr are caught too."""

    def call(*arguments: object) -> Outcome:
        from bokehnet.cli.app import run

        capfd.readouterr()
        code = run([str(argument) for argument in arguments])
        captured = capfd.readouterr()
        return Outcome(code, captured.out, captured.err)

    return call


@pytest.fixture(scope="session")
def cli_process() -> Callable[..., Outcome]:
    """Run the command line in a process of its own, from the repository root."""

    def call(*arguments: object, timeout: float = 300) -> Outcome:
        words = [sys.executable, "-m", "bokehnet", *map(str, arguments)]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=timeout, check=False)
        return Outcome(done.returncode, done.stdout, done.stderr)

    return call


@pytest.fixture(scope="session")
def python_process() -> Callable[..., Outcome]:
    """Run Python source in a fresh interpreter, from the repository root."""

    def call(source: str, *arguments: object, timeout: float = 300) -> Outcome:
        words = [sys.executable, "-c", source, *map(str, arguments)]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=timeout, check=False)
        return Outcome(done.returncode, done.stdout, done.stderr)

    return call


@pytest.fixture(scope="session")
def random_weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder, called neural, with a small untrained ARNet and its manifest."""
    torch = pytest.importorskip("torch")
    from bokehnet.models.arnet import ARNet, ARNetConfig
    from bokehnet.models.onnx_export import export_networks

    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("weights") / "neural"
    export_networks({"arnet": ARNet(ARNetConfig(width=8))}, folder, {"classical": "scatter"})
    return folder


@pytest.fixture(scope="session")
def write_channels() -> Callable[..., None]:
    """Write maps (H, W) as the float channels of an EXR, without the code under test."""

    def write(path: Path, **channels: np.ndarray) -> None:
        array = np.stack(list(channels.values()), -1).astype(np.float32)
        spec = oiio.ImageSpec(array.shape[1], array.shape[0], array.shape[2], "float")
        spec.channelnames = tuple(channels)
        spec.alpha_channel = spec.z_channel = -1
        output = oiio.ImageOutput.create(str(path))
        assert output.open(str(path), spec), output.geterror()
        assert output.write_image(array), output.geterror()
        assert output.close()

    return write


@pytest.fixture(scope="session")
def write_red_network() -> Callable[[Path], None]:
    """Write tiny.onnx, which returns the red channel that it sees, with tiny.toml and metric.toml."""
    onnx = pytest.importorskip("onnx", reason="makes a network with the extra train")

    def write(folder: Path) -> None:
        helper = onnx.helper
        numbers = {"start": 0, "stop": 1, "axes": 1}
        graph = helper.make_graph(
            [helper.make_node("Slice", ["image", *numbers], ["depth"])],
            "tiny",
            [helper.make_tensor_value_info("image", onnx.TensorProto.FLOAT, (1, 3, "h", "w"))],
            [helper.make_tensor_value_info("depth", onnx.TensorProto.FLOAT, None)],
            [onnx.numpy_helper.from_array(np.array([value]), name) for name, value in numbers.items()],
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
        (folder / "tiny.onnx").write_bytes(model.SerializeToString())
        (folder / "tiny.toml").write_text('size = 32\nkernel = "area"\noutput = "disparity"\n')
        (folder / "metric.toml").write_text('size = 32\nwhite = 10.0\noutput = "depth"\nunit = "m"\n')

    return write

"""Test tiers and shared fixtures.

``pytest`` alone runs the quick tier: about three minutes on two cores, without torch, a browser or other
programs. ``pytest --all`` runs everything. ``pytest PATH`` runs everything under that path. ``pytest
tests/golden --against REVISION`` compares outputs with those of another revision.
"""

import gc
import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

ROOT = Path(__file__).resolve().parents[1]
SHARED = Path(os.environ.get("BOKEHNET_SHARED", ROOT.parent / "shared"))

# Folders of tests that start other programs, browsers or processes, or compare with independent renderers.
FULL_TIER = ("end_to_end", "golden", "hosts", "processes", "reference")

# Fixtures that start interpreters: their tests are slow.
PROCESS_FIXTURES = {"built", "cli_process", "python_process", "start_cluster", "warm"}

_TORCH_IMPORT = re.compile(
    r"^\s*(?:import|from) "
    r"(?:torch|kornia|train|benchmarks|bokehnet\.(?:models|raytrace|scenes|synth|torch|classical\.torch))\b"
    r'|^(?:\w+ = )?pytest\.importorskip\("torch"',
    re.MULTILINE,
)

gc.disable()  # during collection: imports allocate millions of objects that all stay alive


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options that select the tier and the revision of the golden set."""
    parser.addoption("--all", action="store_true", help="run every tier, not the quick one alone")
    parser.addoption("--against", metavar="REVISION", help="revision for tests/golden")


def _is_quick(config: pytest.Config) -> bool:
    """Return whether the quick tier was selected: neither ``--all`` nor a path was given."""
    return not config.getoption("--all") and config.args_source != pytest.Config.ArgsSource.ARGS


@cache
def _imports_torch(path: Path) -> bool:
    return path.name.startswith("test_") and bool(_TORCH_IMPORT.search(path.read_text(encoding="utf-8")))


_HAS_TORCH = importlib.util.find_spec("torch") is not None


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files of the full tier in a quick run, and files that import torch where it is absent."""
    if collection_path.is_dir():
        return True if _is_quick(config) and collection_path.name in FULL_TIER else None
    if collection_path.suffix == ".py" and (_is_quick(config) or not _HAS_TORCH):
        return True if _imports_torch(collection_path) else None
    return None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark tests that start an interpreter ``slow``, and deselect slow tests in a quick run.

    A test of a browser or of another program is repeated once: its clock is not the project's own.
    """
    for item in items:
        names = set(getattr(item, "fixturenames", ()))
        if PROCESS_FIXTURES & names:
            item.add_marker("slow")
        if "browser" in names or item.get_closest_marker("host"):
            item.add_marker(pytest.mark.flaky(reruns=1))
    if not _is_quick(config):
        return
    slow = [item for item in items if item.get_closest_marker("slow")]
    config.hook.pytest_deselected(items=slow)
    items[:] = [item for item in items if not item.get_closest_marker("slow")]


def pytest_report_header(config: pytest.Config) -> list[str]:
    """Name the tier, and what cannot run here."""
    lines = [
        "tier: quick (--all runs everything)" if _is_quick(config) else "tier: all under the given paths"
    ]
    if not _HAS_TORCH:
        lines.append("torch is absent: files that import it are not collected; pip install '.[dev]'")
    return lines


def pytest_collection_finish() -> None:
    """Turn garbage collection on again, imports excepted; one torch thread, as test pictures are small."""
    gc.freeze()
    gc.enable()
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


def pytest_unconfigure() -> None:
    """Release what was imported."""
    gc.unfreeze()


@dataclass(frozen=True)
class Outcome:
    """Exit code and output of a command."""

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


@pytest.fixture(scope="session")
def start_cluster():
    """Context of a Ray cluster whose first node, and only one at its start, has that many cores."""
    ray = pytest.importorskip("ray", reason="needs the extra cluster")
    from ray.cluster_utils import Cluster

    @contextmanager
    def start(cores: int):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
            head = {"num_cpus": cores, "include_dashboard": False}
            started = Cluster(initialize_head=True, head_node_args=head, connect=False)
            try:
                yield started
            finally:
                ray.shutdown()
                started.shutdown()

    return start


@pytest.fixture
def cluster(start_cluster):
    """Start a Ray cluster of one core, for one more node that is killed: each node costs four seconds."""
    with start_cluster(1) as started:
        yield started

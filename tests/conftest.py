import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch

ROOT = Path(__file__).resolve().parents[1]
SHARED = Path(os.environ.get("BOKEHNET_SHARED", ROOT.parent / "shared"))


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
    """A folder, called fast, with a small untrained network and its manifest."""
    torch = pytest.importorskip("torch")
    from bokehnet.models.arnet import ARNet, ARNetConfig
    from bokehnet.models.onnx_export import export_networks

    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("weights") / "fast"
    export_networks({"arnet": ARNet(ARNetConfig(width=8))}, folder, {"classical": "scatter"})
    return folder

"""A training run that is killed goes on as if nothing had happened."""

import signal
import time
from pathlib import Path

import pytest
import torch

from bokehnet.models.checkpoint import load_checkpoint, load_network
from tests.unit.train.runs import arguments, end_here, finish_here, start

pytestmark = pytest.mark.train

STEPS = 60


def wait_for(path: Path, changed_since: float = 0.0) -> None:
    deadline = time.monotonic() + 240
    while not path.exists() or path.stat().st_mtime <= changed_since:
        assert time.monotonic() < deadline, f"{path} did not appear"
        time.sleep(0.02)


def assert_same_weights(a: Path, b: Path) -> None:
    first, second = load_checkpoint(a), load_checkpoint(b)
    assert first["step"] == second["step"] == STEPS
    for part in ("network", "raw"):
        for key, weights in first[part].items():
            torch.testing.assert_close(weights, second[part][key], rtol=0, atol=0)


def test_a_killed_run_ends_with_the_weights_of_an_uninterrupted_one(tiny_prepared, tmp_path):
    """SIGKILL at an arbitrary step, then SIGTERM; the last start reaches the end."""
    finish_here(arguments("arnet", tiny_prepared, tmp_path / "whole", STEPS))
    out = tmp_path / "killed"
    line = arguments("arnet", tiny_prepared, out, STEPS)
    seen = 0.0
    for kind in (signal.SIGKILL, signal.SIGTERM):
        process = start(line)
        wait_for(out / "last.pt", seen)
        process.send_signal(kind)
        process.communicate(timeout=60)
        seen = (out / "last.pt").stat().st_mtime
        assert load_checkpoint(out / "last.pt")["step"] <= STEPS
    finish_here(line)
    assert_same_weights(tmp_path / "whole/last.pt", out / "last.pt")


def test_iunet_trains_behind_arnet_and_both_export(tiny_prepared, tmp_path):
    """The whole path: pairs, ARNet, IUNet, ONNX, and the torch-free renderer takes the result."""
    from bokehnet.models.onnx_export import export_networks
    from bokehnet.render.renderer import BokehRenderer

    finish_here(arguments("arnet", tiny_prepared, tmp_path / "a", 4))
    arnet = tmp_path / "a/last.pt"
    finish_here(arguments("iunet", tiny_prepared, tmp_path / "i", 4, arnet=f'"{arnet}"'))
    networks = {name: load_network(tmp_path / name[0] / "last.pt", name) for name in ("arnet", "iunet")}
    export_networks(networks, tmp_path / "weights", {"classical": "rays"})
    BokehRenderer("hybrid", weights=tmp_path / "weights")
    assert list((tmp_path / "i").glob("events.out.tfevents.*"))


def test_mistakes_are_one_line(tiny_prepared, tmp_path):
    line = arguments("arnet", tiny_prepared, tmp_path / "a", 2)
    finish_here(line)

    process = start([*line, "--set", "optim.learning_rate=0.1"])
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    other = errors.strip()
    assert "optim.learning_rate = 0.0005, but 0.1 was requested" in other
    assert other.count("\n") == 0

    def error_of(arguments: list[str]) -> str:
        code, _ = end_here(arguments)
        assert isinstance(code, str)
        return code

    assert "unknown key 'optim.speed'; valid keys" in error_of([*line, "--set", "optim.speed=3"])
    missing = error_of(arguments("iunet", tiny_prepared, tmp_path / "i", 2, arnet='"nowhere.pt"'))
    assert "no checkpoint at nowhere.pt" in missing
    empty = arguments("arnet", tmp_path / "nothing", tmp_path / "b", 2)
    assert "run python -m train.prepare" in error_of(empty)

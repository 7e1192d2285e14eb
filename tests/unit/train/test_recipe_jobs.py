"""Steps of a recipe in processes of their own, side by side: stopped, killed and failing."""

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.unit.train.runs import ROOT

pytestmark = pytest.mark.train

SETTINGS = (
    '"optim.warmup=1", "optim.validate_every=100000", "optim.checkpoint_every=2", "held_out=1", '
    '"data.batch_size=2", "data.coarse_crop=16", "data.most_halvings=1", "model.unet=[8, 12, 16]"'
)

DATA = "data/planes", "data/planes_val", "data/rays", "data/rays_val"


def started(folder: Path, **steps: int) -> subprocess.Popen:
    """A recipe of some planes and of trainings side by side, which learn for that many steps."""
    texts = ["workers = 2\nthreads = 1"]
    for makes in DATA[:2]:
        texts.append(f'[[steps]]\nmakes = "{makes}"\nby = "synth"\nconfig = "configs/synth_tiny.toml"')
    for kind in ("rays", "rays_val"):
        texts.append(
            f'[[steps]]\nmakes = "data/{kind}"\nby = "prepare"\nconfig = "configs/prepare_{kind}.toml"\n'
            'settings = ["repaired=0"]'
        )
    for name, count in steps.items():
        texts.append(
            f'[[steps]]\nmakes = "runs/{name}"\nby = "arnet"\nconfig = "configs/train_arnet.toml"\n'
            f'settings = ["optim.steps={count}", {SETTINGS}]'
        )
    (folder / "recipe.toml").write_text("\n".join(texts))
    words = ["--config", str(folder / "recipe.toml"), "--out", str(folder / "out")]
    line = [sys.executable, "-m", "train.recipe", *words]
    return subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_until(true: Callable[[], bool], recipe: subprocess.Popen) -> None:
    deadline = time.monotonic() + 200
    while not true():
        assert recipe.poll() is None, recipe.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)


def states(folder: Path) -> dict[str, bool]:
    summary = json.loads((folder / "out/recipe.json").read_text())["steps"]
    return {makes: step["done"] for makes, step in summary.items()}


@pytest.mark.slow
def test_trainings_side_by_side_stop_with_a_checkpoint_and_do_not_outlive_the_recipe(tmp_path):
    checkpoints = [tmp_path / f"out/runs/{name}/last.pt" for name in ("one", "two")]
    recipe = started(tmp_path, one=10**6, two=10**6)
    wait_until(lambda: all(path.exists() for path in checkpoints), recipe)
    recipe.send_signal(signal.SIGTERM)
    said, errors = recipe.communicate(timeout=60)
    assert recipe.returncode == 130, errors
    assert "stopped; run the same command again to resume" in errors
    assert "Traceback" not in errors
    assert re.findall(r"^(\S+): done", said, re.MULTILINE) == list(DATA)
    assert states(tmp_path) == {**dict.fromkeys(DATA, True), "runs/one": False, "runs/two": False}
    for name in ("one", "two"):
        assert "stopped at step" in (tmp_path / f"out/logs/runs-{name}.log").read_text()

    before = [path.stat().st_mtime_ns for path in checkpoints]
    recipe = started(tmp_path, one=10**6, two=10**6)
    wait_until(
        lambda: all(path.stat().st_mtime_ns != x for path, x in zip(checkpoints, before, strict=True)), recipe
    )
    recipe.kill()
    said, _ = recipe.communicate(timeout=60)
    assert len(re.findall(r"^\[\d/6\]", said, re.MULTILINE)) == 2
    time.sleep(1)
    killed = [path.stat().st_mtime_ns for path in checkpoints]
    time.sleep(2)  # in which a training that lives would write dozens of checkpoints
    assert [path.stat().st_mtime_ns for path in checkpoints] == killed


@pytest.mark.slow
def test_one_that_fails_is_named_and_the_others_stop_with_a_checkpoint(tmp_path):
    recipe = started(tmp_path, one=10**6, broken=-5)
    _, errors = recipe.communicate(timeout=200)
    assert recipe.returncode == 1
    message = "error: runs/broken: optim.steps: expected 1 or more steps, found -5 (log: "
    assert errors.startswith(message + str(tmp_path / "out/logs/runs-broken.log"))
    assert states(tmp_path)["runs/one"] is False

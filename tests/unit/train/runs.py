"""Small training runs in processes of their own."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]


def arguments(name: str, data: Path, out: Path, steps: int, **values: object) -> list[str]:
    """Command line of a training run that takes a second."""
    settings = {
        "data.folder": f'"{data}"',
        "data.validation": f'"{data}"',
        "data.batch_size": 2,
        "data.coarse_crop": 32,
        "data.fine_crop": 64,
        "model.width": 8,
        "model.num_blocks": 1,
        "model.unet": "[]",
        "optim.steps": steps,
        "optim.warmup": 2,
        "optim.checkpoint_every": 2,
        "optim.validate_every": 1000,
        "optim.bfloat16": "false",
        "held_out": 2,
        **values,
    }
    line = [sys.executable, "-m", f"train.train_{name}", "--out", str(out), "--device", "cpu"]
    line += ["--config", str(ROOT / f"configs/train_{name}.toml")]
    return line + [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]


def start(line: list[str]) -> subprocess.Popen:
    """Start a run; its output is read by ``communicate``."""
    return subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(line: list[str]) -> str:
    """Run to the end and return what it said on stderr."""
    process = start(line)
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    return errors

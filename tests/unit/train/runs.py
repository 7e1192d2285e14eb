"""Small training runs, in processes of their own or in this one."""

import contextlib
import importlib
import io
import os
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
    """Start a run on one thread, as runs in this process have; its output is read by ``communicate``."""
    return subprocess.Popen(
        line,
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(line: list[str]) -> str:
    """Run to the end and return what it said on stderr."""
    process = start(line)
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors
    return errors


def end_here(line: list[str]) -> tuple[object, str]:
    """Run the line in this process, which starts sooner; its exit code, and what it said on stderr.

    As in ``sys.exit``, a text as the code stands for 1 and a line on stderr.
    """
    assert line[:2] == [sys.executable, "-m"]
    with contextlib.redirect_stderr(io.StringIO()) as errors:
        try:
            importlib.import_module(line[2]).main(line[3:])
        except SystemExit as end:
            return end.code or 0, errors.getvalue()
    return 0, errors.getvalue()


def finish_here(line: list[str]) -> str:
    """Run to the end in this process and return what it said on stderr."""
    code, errors = end_here(line)
    assert code == 0, (code, errors)
    return errors

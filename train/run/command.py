"""Command line of the training scripts."""

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torch

from bokehnet.config import load_config, parse_settings
from bokehnet.errors import BokehnetError
from train.run.distributed import Processes, joined
from train.run.ray_train import train_on_ray
from train.run.stopping import Stopped

__all__ = ["add_settings", "run_command", "settings_of"]


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the option that replaces values of a configuration."""
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="replace a value")


def settings_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the values of ``--set`` by dotted key."""
    return parse_settings(arguments.set)


def run_command(
    description: str | None,
    cls: type,
    run: Callable[[Any, Path, torch.device, float], Path],
    words: Sequence[str] | None = None,
) -> None:
    """Parse the arguments, load the configuration and run; a user error prints one line and exits with 1.

    A process started by ``torchrun`` joins the others first.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--config", required=True, type=Path, help="TOML file of the run")
    parser.add_argument(
        "--out", required=True, type=Path, help="folder of the run; resumes a run that it already holds"
    )
    add_settings(parser)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument(
        "--max-minutes",
        type=float,
        default=math.inf,
        help="time limit, minutes; writes a checkpoint and stops",
    )
    parser.add_argument("--ray", metavar="ADDRESS", help="train on this Ray cluster, by Ray Train")
    arguments = parser.parse_args(words)
    stopped = None
    try:
        config = load_config(arguments.config, cls, settings_of(arguments))
        with joined(torch.device(arguments.device)) as device:
            first = Processes.current().first
            job = (config, arguments.out, device, arguments.max_minutes)
            try:
                path = train_on_ray(run, *job, arguments.ray) if arguments.ray else run(*job)
            except Stopped as error:
                # Its traceback would keep the objects of the run alive until after the process group has
                # ended.
                stopped = error.with_traceback(None)
    except BokehnetError as error:
        sys.exit(f"error: {' '.join(str(error).split())}")
    if stopped is not None:
        if first:
            print(stopped, file=sys.stderr)
        sys.exit(130 if stopped.interrupted else 0)
    if first:
        print(f"done: {path}")

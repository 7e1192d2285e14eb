"""Driver of the trainings through the rays: phases, checkpoints, seeds, scores and figures."""

import argparse
import copy
import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from tqdm import tqdm

from benchmarks.experiments.networks.views import (
    KINDS,
    TrainingView,
    busy_window,
    mean_scores,
)
from benchmarks.figures import write_figures
from benchmarks.quality.scenes.repair_material import MAX_RADIUS_PX
from bokehnet.io.files.atomic import write_text

__all__ = ["INSIDE", "Batch", "Crops", "Phase", "parse_arguments", "report_scores", "train_seeds"]

# Steps between checkpoints.
_SAVE_EVERY = 100

Batch = dict[str, Tensor]

# Part of a crop whose light comes from the crop alone.
_MARGIN_PX = math.ceil(MAX_RADIUS_PX)
INSIDE = (..., slice(_MARGIN_PX, -_MARGIN_PX), slice(_MARGIN_PX, -_MARGIN_PX))


class Crops:
    """Random crops of what a network sees of views, turned, with exchanged colours; and of their truth.

    Args:
        views: Scenes.
        see: Function of a view and one of its maps that returns arrays (..., H, W) by name.
        exact_fraction: Fraction of the crops with the exact map; the others have the repaired one.
    """

    def __init__(
        self,
        views: list[TrainingView],
        see: Callable[[TrainingView, np.ndarray], dict[str, np.ndarray]],
        exact_fraction: float,
    ) -> None:
        self._views, self._exact_fraction = views, exact_fraction
        self._seen = [
            [see(view, disparity) for disparity in (view.true, view.repaired)]
            for view in tqdm(views, desc="inputs", mininterval=10)
        ]

    def __call__(self, rng: np.random.Generator, count: int) -> Batch:
        """Return ``count`` crops; arrays with three colours have them as the third axis from the end."""
        rows: dict[str, list[np.ndarray]] = {}
        for _ in range(count):
            number = int(rng.integers(len(self._views)))
            view = self._views[number]
            seen = self._seen[number][int(rng.random() > self._exact_fraction)]
            window, turn, order = busy_window(view.true, rng), int(rng.integers(4)), rng.permutation(3)
            for name, values in (seen | {"truth": view.truth.transpose(2, 0, 1)}).items():
                turned = np.rot90(values[..., *window], turn, axes=(-2, -1))
                colors = turned[..., order, :, :] if turned.shape[-3] == 3 else turned
                rows.setdefault(name, []).append(colors)
        return {name: torch.from_numpy(np.stack(arrays)) for name, arrays in rows.items()}


@dataclass(frozen=True, kw_only=True, slots=True)
class Phase:
    """Part of a training: its crops, its error after and before correction, learning rate and steps.

    ``draw`` gets a random generator and the number of crops.
    """

    name: str
    draw: Callable[[np.random.Generator, int], Batch]
    error: Callable[[Any, Batch], tuple[Tensor, Tensor]]
    rate: float
    crops: int
    steps: int


def _train(network: nn.Module, phase: Phase, seed: int, path: Path) -> list[float]:
    """Train or resume; return the error over that before correction, by tenths of the run."""
    optimizer = torch.optim.Adam(network.parameters(), phase.rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, phase.rate, phase.steps + 1, pct_start=0.1)
    ratios: list[tuple[float, float]] = []
    parts: dict[str, Any] = {"network": network, "optimizer": optimizer, "schedule": schedule}
    first = 0
    if path.exists():
        state = torch.load(path, weights_only=True)
        first, ratios = state["step"], state["ratios"]
        for name, part in parts.items():
            part.load_state_dict(state[name])
    for step in tqdm(range(first, phase.steps), desc=f"{phase.name}, seed {seed}", mininterval=10):
        batch = phase.draw(np.random.default_rng([seed, phase.crops, step]), phase.crops)
        error, before = phase.error(network, batch)
        optimizer.zero_grad()
        error.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        ratios.append((float(error.detach()), float(before)))
        if (step + 1) % _SAVE_EVERY == 0 or step + 1 == phase.steps:
            states = {name: part.state_dict() for name, part in parts.items()}
            torch.save(states | {"step": step + 1, "ratios": ratios}, path)
    tenths = np.array_split(np.array(ratios), min(10, phase.steps))
    return [float(part[:, 0].sum() / part[:, 1].sum()) for part in tenths]


def parse_arguments(description: str | None, scenes: int, steps: int) -> argparse.Namespace:
    """Return the options that all trainings through the rays have; the numbers are defaults."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("cache", type=Path, help="folder of the traced scenes; missing ones are traced")
    parser.add_argument("--checkpoints", type=Path, required=True, help="folder of the checkpoints")
    parser.add_argument("--scenes", type=int, default=scenes, help="training scenes")
    parser.add_argument("--steps", type=int, default=steps, help="steps of the last phase")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--test-scenes", type=int, default=6)
    parser.add_argument("--figures", type=Path, help="JSON file for the tables of the documentation")
    parser.add_argument("--curves", type=Path, help="JSON file of the training curves")
    return parser.parse_args()


def train_seeds(
    arguments: argparse.Namespace, make_network: Callable[[], nn.Module], phases: Sequence[Phase]
) -> dict[str, Any]:
    """Train all phases with each seed, print and write the curves; return the networks by phase and seed."""
    torch.set_num_threads(1)
    arguments.checkpoints.mkdir(parents=True, exist_ok=True)
    networks: dict[str, Any] = {}
    curves: dict[str, list[float]] = {}
    for seed in arguments.seeds:
        torch.manual_seed(seed)
        network = make_network()
        for phase in phases:
            name, begun = f"{phase.name}, seed {seed}", time.process_time()
            path = arguments.checkpoints / f"{phase.name}_{seed}.pt"
            curves[name] = _train(network, phase, seed, path)
            networks[name] = copy.deepcopy(network).eval()
            minutes = (time.process_time() - begun) / 60
            print(f"{name}: {minutes:.1f} processor minutes; error over that before correction, by tenths:")
            print("  " + " ".join(f"{x:.3f}" for x in curves[name]), flush=True)
    if arguments.curves:
        write_text(arguments.curves, json.dumps(curves, indent=1) + "\n")
    return networks


def report_scores(
    arguments: argparse.Namespace, render: Callable[[TrainingView], dict[str, np.ndarray]]
) -> None:
    """Score the pictures of all methods, print the scores, and write them as figures if asked for.

    Args:
        arguments: Options of :func:`parse_arguments`.
        render: Function that returns the pictures of a view by method.
    """
    rows = mean_scores(arguments.cache, arguments.test_scenes, render)
    for name, row in rows.items():
        print(f"{name:22s}" + "".join(f"{kind} {value:6.2f}  " for kind, value in row.items()), flush=True)
    if arguments.figures:
        module = sys.modules["__main__"].__spec__
        words = f"--scenes {arguments.scenes} --steps {arguments.steps} --test-scenes {arguments.test_scenes}"
        command = f"python -m {module.name if module else '?'} CACHE {words}"
        conditions = "edge PSNR in dB, means over cluttered scenes that no training scene resembles"
        columns = {kind: (kind, ".2f") for kind in KINDS}
        write_figures(arguments.figures, command, conditions, columns, rows)

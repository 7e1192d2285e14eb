"""Corrector of depth maps that is trained through the rays.

``python -m benchmarks.experiments.networks.train_through_rays TRAINING TEST --checkpoints FOLDER``

A small network moves the edges of a map that the repair has left, in the range of the depths around each
pixel. It is trained twice: first by depth, the cross entropy of the position between the local extremes;
then through the rays, by the error of the picture that :func:`bokehnet.torch.layered` renders with the
corrected map, against the traced picture. Both states are scored by the rays of the package on scenes of
another kind, with faults that the training does not have.
Checkpoints in ``--checkpoints`` are used again.

Rule: it is of use only if wrong maps gain 0.3 dB at edges in the mean and true maps lose at most 0.02 dB.
"""

import argparse
import copy
import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn
from tqdm import tqdm

from benchmarks.figures import write_figures
from bokehnet.classical.rays_renderer import rays
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.io.files.atomic import write_text
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.optics.encoding import encode
from bokehnet.synth.shards import ShardSet, TrainingSample
from bokehnet.torch import layered, split_layers
from train.data.augmentation import augment_disparity
from train.data.degradation import DEGRADED, degrade
from train.scores.metrics import compare

# Half-width in pixels of the window whose extremes bound a correction.
_REACH_PX = 3

# Side of a crop in pixels, crops per step, pupil samples, and the largest blur of a view in pixels, which is
# the margin of a crop without loss.
CROP_PX, _BATCH, _SAMPLES, MAX_BLUR_PX = 60, 2, 4, 10

# Candidates of a crop, and the minimum difference of neighbours at a depth edge, as a fraction of the range;
# a crop without a depth edge teaches nothing.
_CANDIDATE_CROPS, _MIN_STEP = 3, 0.03

# Crops per step of the training by depth, and the disparity step of half weight, as a fraction of the range.
_DEPTH_BATCH, _HALF_WEIGHT_STEP = 8, 0.05

# Fraction of the examples with the true map.
_TRUE_FRACTION = 0.35

_DEPTH_RATE, _RATE = 2e-3, 5e-4

# Steps between checkpoints.
_SAVE_EVERY = 100

Batch = dict[str, Tensor]


class Corrector(nn.Module):
    """Network that corrects a map within its local extremes.

    Shape:
        image (B, 3, H, W), scene-linear; disparity (B, 1, H, W). It starts as the identity.
    """

    def __init__(self, width: int = 24, depth: int = 4) -> None:
        super().__init__()
        layers: list[nn.Module] = [nn.Conv2d(5, width, 3, padding=1), nn.ELU()]
        for number in range(depth):
            dilation = 2 ** (number % 3)
            layers += [nn.Conv2d(width, width, 3, padding=dilation, dilation=dilation), nn.ELU()]
        head = nn.Conv2d(width, 1, 3, padding=1)
        nn.init.zeros_(head.weight)
        self.body = nn.Sequential(*layers, head)

    def positions(self, image: Tensor, disparity: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return positions between the local extremes before and after, and the width between them."""
        low, high = _extremes(disparity)
        position = ((disparity - low) / (high - low + 0.01)).clamp(0.02, 0.98)
        logit = self.body(torch.cat([encode(image), position, high - low], 1))
        return position, (torch.logit(position) + logit).sigmoid(), high - low

    def forward(self, image: Tensor, disparity: Tensor) -> Tensor:
        """Return the corrected disparity."""
        before, after, width = self.positions(image, disparity)
        return disparity + width * (after - before)


def _extremes(disparity: Tensor) -> tuple[Tensor, Tensor]:
    """Return the local minimum and maximum of a map."""
    side = 2 * _REACH_PX + 1
    low = -F.max_pool2d(-disparity, side, 1, _REACH_PX)
    return low, F.max_pool2d(disparity, side, 1, _REACH_PX)


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """Scene with a map as the default repair leaves it; ``truth`` (H, W, 3) is the traced picture."""

    image: np.ndarray
    true: np.ndarray
    repaired: np.ndarray
    truth: np.ndarray
    blur: float
    focus: float


def training_views(folder: Path, count: int, seed: int) -> list[View]:
    """Return the views of the first ``count`` scenes that are blurred little enough for a crop."""
    repair, rng, views = DisparityRepair(), np.random.default_rng(seed), []
    for sample in tqdm([x for _, x in zip(range(count), samples_of(folder), strict=False)], desc="maps"):
        image, true = sample.image.astype(np.float32), sample.disparity
        for view, (blur, focus) in enumerate(zip(sample.blur, sample.focus, strict=True)):
            if np.abs(defocus_from_disparity(true, blur, focus)).max() > MAX_BLUR_PX:
                continue
            wrong = repair(image, augment_disparity(true, rng, image), "auto")
            truth = sample.bokeh[view].astype(np.float32)
            views.append(
                View(
                    image=image,
                    true=true,
                    repaired=wrong,
                    truth=truth,
                    blur=float(blur),
                    focus=float(focus),
                )
            )
    return views


def samples_of(folder: Path) -> Iterator[TrainingSample]:
    """Return the scenes of a folder of shards."""
    shards = ShardSet(folder)
    return (shards[number] for number in range(len(shards)))


def busy_window(true: np.ndarray, rng: np.random.Generator) -> tuple[slice, slice]:
    """Return the window with the most depth edges of a few random ones."""
    edges = np.zeros(true.shape, bool)
    edges[1:] |= np.abs(np.diff(true, axis=0)) > _MIN_STEP * np.ptp(true)
    edges[:, 1:] |= np.abs(np.diff(true, axis=1)) > _MIN_STEP * np.ptp(true)
    tops, lefts = (rng.integers(max(1, side - CROP_PX + 1), size=_CANDIDATE_CROPS) for side in true.shape)
    windows = [np.s_[y : y + CROP_PX, x : x + CROP_PX] for y, x in zip(tops, lefts, strict=True)]
    return max(windows, key=lambda window: int(edges[window].sum()))


def _batch(views: list[View], rng: np.random.Generator, count: int) -> Batch:
    """Draw crops at depth edges."""
    rows: dict[str, list[np.ndarray]] = {key: [] for key in ("image", "map", "true", "truth", "numbers")}
    for _ in range(count):
        view = views[int(rng.integers(len(views)))]
        window = busy_window(view.true, rng)
        source = view.true if rng.random() < _TRUE_FRACTION else view.repaired
        rows["image"].append(view.image[window].transpose(2, 0, 1))
        rows["map"].append(source[window][None])
        rows["true"].append(view.true[window][None])
        rows["truth"].append(view.truth[window].transpose(2, 0, 1))
        rows["numbers"].append(np.array([view.blur, view.focus], np.float32))
    return {key: torch.from_numpy(np.stack(values).astype(np.float32)) for key, values in rows.items()}


def _render(image: Tensor, disparity: Tensor, numbers: Tensor) -> Tensor:
    """Render through layers; the hidden layers are constants, the visible surface has the gradient."""
    blur, focus = numbers[:, 0, None, None, None], numbers[:, 1, None, None, None]
    defocus = blur * (disparity - focus)
    first, radius, background, coverage = split_layers(image, defocus.detach())
    radius = radius + (defocus - defocus.detach())
    return layered(first, radius, background, coverage, samples=_SAMPLES)


def _depth_error(network: Corrector, batch: Batch) -> tuple[Tensor, Tensor]:
    """Return the cross entropy of the positions after and before correction."""
    before, after, width = network.positions(batch["image"], batch["map"])
    target = ((batch["true"] - _extremes(batch["map"])[0]) / width.clamp(min=1e-6)).clamp(0, 1)
    weight = width / (width + _HALF_WEIGHT_STEP)
    errors = [F.binary_cross_entropy(x, target, weight) for x in (after, before)]
    return errors[0], errors[1].detach()


def _picture_error(network: Corrector, batch: Batch) -> tuple[Tensor, Tensor]:
    """Return the error of the rendered picture after and before correction."""
    inside = (..., slice(MAX_BLUR_PX, -MAX_BLUR_PX), slice(MAX_BLUR_PX, -MAX_BLUR_PX))
    truth = encode(batch["truth"])

    def error(disparity: Tensor) -> Tensor:
        picture = encode(_render(batch["image"], disparity, batch["numbers"]))
        return (picture - truth)[inside].abs().mean()

    with torch.no_grad():
        before = error(batch["map"])
    return error(network(batch["image"], batch["map"])), before


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


def train(network: nn.Module, phase: Phase, seed: int, path: Path) -> list[float]:
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


@torch.no_grad()
def _corrected(network: Corrector, image: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    picture = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))[None]
    result: np.ndarray = network(picture, torch.from_numpy(disparity)[None, None])[0, 0].numpy()
    return result


@dataclass(frozen=True, kw_only=True, slots=True)
class TestView:
    """Scene of the test with a repaired map, and its camera."""

    image: np.ndarray
    repaired: np.ndarray
    blur: float
    focus: float


def score(
    folder: Path, count: int, render: Callable[[TestView], dict[str, np.ndarray]]
) -> dict[str, dict[str, float]]:
    """Return the edge PSNR in dB by method and kind of map.

    Args:
        folder: Shards of scenes.
        count: Number of scenes.
        render: Function that returns the pictures of all methods.
    """
    repair = DisparityRepair()
    sums: dict[str, dict[str, list[float]]] = {}
    for sample in tqdm(list(samples_of(folder))[:count], desc="scores"):
        image, truth = sample.image.astype(np.float32), sample.bokeh[0].astype(np.float32)
        blur, focus = float(sample.blur[0]), float(sample.focus[0])
        true = defocus_from_disparity(sample.disparity, blur, focus)
        for kind in ("true", *DEGRADED):
            wrong = sample.disparity if kind == "true" else degrade(sample.disparity, kind)
            view = TestView(image=image, repaired=repair(image, wrong, "auto"), blur=blur, focus=focus)
            for name, bokeh in render(view).items():
                sums.setdefault(name, {}).setdefault(kind, []).append(
                    compare(bokeh, truth, true)["edge_psnr"]
                )
    return {name: {kind: float(np.mean(x)) for kind, x in row.items()} for name, row in sums.items()}


def arguments_parser(
    description: str | None, scenes: int, test_scenes: int, steps: int
) -> argparse.ArgumentParser:
    """Return the options that all trainings through the rays have; the numbers are defaults."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("training", type=Path, help="shards of bokehnet synth for training")
    parser.add_argument("test", type=Path, help="shards of another kind of scene")
    parser.add_argument("--checkpoints", type=Path, required=True, help="folder of the checkpoints")
    parser.add_argument("--scenes", type=int, default=scenes, help="training scenes")
    parser.add_argument("--steps", type=int, default=steps, help="steps through the rays")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--test-scenes", type=int, default=test_scenes)
    parser.add_argument("--figures", type=Path, help="JSON file for the tables of the documentation")
    parser.add_argument("--curves", type=Path, help="JSON file of the training curves")
    return parser


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
            curves[name] = train(network, phase, seed, path)
            networks[name] = copy.deepcopy(network).eval()
            minutes = (time.process_time() - begun) / 60
            print(f"{name}: {minutes:.1f} processor minutes; error over that before correction, by tenths:")
            print("  " + " ".join(f"{x:.3f}" for x in curves[name]), flush=True)
    if arguments.curves:
        write_text(arguments.curves, json.dumps(curves, indent=1) + "\n")
    return networks


def report_scores(
    arguments: argparse.Namespace, rows: dict[str, dict[str, float]], command: str, conditions: str
) -> None:
    """Add the mean of wrong maps to the scores, print them, and write them as figures if asked for."""
    for name, row in rows.items():
        row["wrong"] = float(np.mean([row[kind] for kind in DEGRADED]))
        print(f"{name:16s}" + "".join(f"{kind} {value:6.2f}  " for kind, value in row.items()), flush=True)
    if arguments.figures:
        columns = {kind: (kind, ".2f") for kind in ("true", *DEGRADED, "wrong")}
        write_figures(arguments.figures, command, conditions, columns, rows)


def main() -> None:
    """Entry of the command line."""
    parser = arguments_parser(__doc__, scenes=60, test_scenes=12, steps=1200)
    parser.add_argument("--depth-steps", type=int, default=2000, help="steps by the error of the depth")
    arguments = parser.parse_args()
    views = training_views(arguments.training, arguments.scenes, 0)

    def draw(rng: np.random.Generator, count: int) -> Batch:
        return _batch(views, rng, count)

    phases = (
        Phase(
            name="depth",
            draw=draw,
            error=_depth_error,
            rate=_DEPTH_RATE,
            crops=_DEPTH_BATCH,
            steps=arguments.depth_steps,
        ),
        Phase(
            name="rays",
            draw=draw,
            error=_picture_error,
            rate=_RATE,
            crops=_BATCH,
            steps=arguments.steps,
        ),
    )
    networks = train_seeds(arguments, Corrector, phases)

    def render(view: TestView) -> dict[str, np.ndarray]:
        maps = {"default": view.repaired}
        maps |= {name: _corrected(network, view.image, view.repaired) for name, network in networks.items()}
        return {
            name: rays(view.image, defocus_from_disparity(disparity, view.blur, view.focus))
            for name, disparity in maps.items()
        }

    rows = score(arguments.test, arguments.test_scenes, render)
    steps = f"--depth-steps {arguments.depth_steps} --steps {arguments.steps}"
    command = f"python -m benchmarks.experiments.networks.train_through_rays TRAINING TEST {steps}"
    conditions = f"edge PSNR in dB, {len(views)} views in training, scenes of another kind in the test"
    report_scores(arguments, rows, command, conditions)


if __name__ == "__main__":
    main()

"""Corrector of depth maps that is trained through the rays.

``python -m benchmarks.experiments.networks.train_through_rays TRAINING TEST``

A small network moves the edges of a map that the repair has left, in the range of the depths around each
pixel. Its loss is the error of the picture that :func:`bokehnet.torch.layered` renders with the corrected
map, against the traced picture; no depth is compared. A learned gate selects where it acts. It is scored by
the rays of the package on scenes of another kind, with faults that the training does not have.

Rule: it is of use only if wrong maps gain 0.3 dB at edges in the mean and true maps lose at most 0.02 dB.
"""

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

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
from train.data.repair_data import busy_window
from train.scores.metrics import compare

# Half-width in pixels of the window whose extremes bound a correction.
_REACH_PX = 3

# Side of a crop in pixels, crops per step, pupil samples, and the largest blur of a view in pixels.
_CROP_PX, _BATCH, _SAMPLES, _MAX_BLUR_PX = 40, 2, 6, 12.0

# Fraction of the examples with the true map.
_TRUE_FRACTION = 0.35

_LEARNING_RATE = 1e-3

# Steps between points of the training curve.
_LOG_EVERY = 4


class Corrector(nn.Module):
    """Network that corrects a map within its local extremes, where its gate is open.

    Shape:
        image (B, 3, H, W), scene-linear; disparity (B, 1, H, W). Returns the corrected disparity and the
        gate, both (B, 1, H, W). It starts as the identity.
    """

    def __init__(self, width: int = 24, depth: int = 4) -> None:
        super().__init__()
        layers: list[nn.Module] = [nn.Conv2d(5, width, 3, padding=1), nn.ELU()]
        for number in range(depth):
            dilation = 2 ** (number % 3)
            layers += [nn.Conv2d(width, width, 3, padding=dilation, dilation=dilation), nn.ELU()]
        head = nn.Conv2d(width, 2, 3, padding=1)
        nn.init.zeros_(head.weight)
        self.body = nn.Sequential(*layers, head)

    def forward(self, image: Tensor, disparity: Tensor) -> tuple[Tensor, Tensor]:
        """Return corrected disparity and gate."""
        side = 2 * _REACH_PX + 1
        high = F.max_pool2d(disparity, side, 1, _REACH_PX)
        low = -F.max_pool2d(-disparity, side, 1, _REACH_PX)
        position = ((disparity - low) / (high - low + 0.01)).clamp(0.02, 0.98)
        logit, gate = self.body(torch.cat([encode(image), position, high - low], 1)).split(1, 1)
        gate = gate.sigmoid()
        moved = low + (high - low) * (torch.logit(position) + logit).sigmoid()
        same = low + (high - low) * position
        return disparity + gate * (moved - same), gate


@dataclass(frozen=True, kw_only=True, slots=True)
class _View:
    """Scene with a map as the default repair leaves it; ``truth`` (H, W, 3) is the traced picture."""

    image: np.ndarray
    true: np.ndarray
    repaired: np.ndarray
    truth: np.ndarray
    blur: float
    focus: float


def _training_views(folder: Path, count: int, seed: int) -> list[_View]:
    repair, rng, views = DisparityRepair(threads=1), np.random.default_rng(seed), []
    for sample in tqdm([x for _, x in zip(range(count), _samples(folder), strict=False)], desc="maps"):
        image, true = sample.image.astype(np.float32), sample.disparity
        wrong = repair(image, augment_disparity(true, rng, image), "auto")
        for view, (blur, focus) in enumerate(zip(sample.blur, sample.focus, strict=True)):
            if np.abs(defocus_from_disparity(true, blur, focus)).max() > _MAX_BLUR_PX:
                continue
            truth = sample.bokeh[view].astype(np.float32)
            views.append(
                _View(
                    image=image,
                    true=true,
                    repaired=wrong,
                    truth=truth,
                    blur=float(blur),
                    focus=float(focus),
                )
            )
    return views


def _samples(folder: Path) -> Iterator[TrainingSample]:
    shards = ShardSet(folder)
    return (shards[number] for number in range(len(shards)))


def _batch(views: list[_View], rng: np.random.Generator) -> dict[str, Tensor]:
    """Draw crops at depth edges."""
    rows: dict[str, list[np.ndarray]] = {key: [] for key in ("image", "map", "truth", "numbers")}
    for _ in range(_BATCH):
        view = views[int(rng.integers(len(views)))]
        window = busy_window(view.true, _CROP_PX, rng)
        source = view.true if rng.random() < _TRUE_FRACTION else view.repaired
        rows["image"].append(view.image[window].transpose(2, 0, 1))
        rows["map"].append(source[window][None])
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


def train(views: list[_View], seed: int, steps: int) -> tuple[Corrector, list[float]]:
    """Return the trained network, and the mean picture error of each tenth, of that without correction."""
    torch.manual_seed(seed)
    network, rng = Corrector(), np.random.default_rng([seed, 1])
    optimizer = torch.optim.Adam(network.parameters(), _LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, _LEARNING_RATE, steps + 1, pct_start=0.1)
    ratios = []
    for step in tqdm(range(steps), desc=f"seed {seed}"):
        batch = _batch(views, rng)
        disparity, _ = network(batch["image"], batch["map"])
        truth = encode(batch["truth"])
        error = (encode(_render(batch["image"], disparity, batch["numbers"])) - truth).abs().mean()
        optimizer.zero_grad()
        error.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimizer.step()
        schedule.step()
        if step % _LOG_EVERY == 0:
            with torch.no_grad():
                before = encode(_render(batch["image"], batch["map"], batch["numbers"])) - truth
            ratios.append(float(error.detach() / before.abs().mean()))
    return network.eval(), [float(np.mean(part)) for part in np.array_split(ratios, 10)]


@torch.no_grad()
def _corrected(network: Corrector, image: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    picture = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))[None]
    result: np.ndarray = network(picture, torch.from_numpy(disparity)[None, None])[0][0, 0].numpy()
    return result


def score(folder: Path, count: int, networks: dict[str, Corrector]) -> dict[str, dict[str, float]]:
    """Return the edge PSNR of the package's rays in dB by method and kind of map."""
    repair = DisparityRepair(threads=1)
    sums: dict[str, dict[str, list[float]]] = {}
    for sample in tqdm(list(_samples(folder))[:count], desc="scores"):
        image, truth = sample.image.astype(np.float32), sample.bokeh[0].astype(np.float32)
        blur, focus = sample.blur[0], sample.focus[0]
        true = defocus_from_disparity(sample.disparity, blur, focus)
        for kind in ("true", *DEGRADED):
            wrong = sample.disparity if kind == "true" else degrade(sample.disparity, kind)
            repaired = repair(image, wrong, "auto")
            maps = {"default": repaired}
            maps |= {name: _corrected(network, image, repaired) for name, network in networks.items()}
            for name, disparity in maps.items():
                bokeh = rays(image, defocus_from_disparity(disparity, blur, focus))
                sums.setdefault(name, {}).setdefault(kind, []).append(
                    compare(bokeh, truth, true)["edge_psnr"]
                )
    return {name: {kind: float(np.mean(x)) for kind, x in row.items()} for name, row in sums.items()}


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("training", type=Path, help="shards of bokehnet synth for training")
    parser.add_argument("test", type=Path, help="shards of another kind of scene")
    parser.add_argument("--scenes", type=int, default=120, help="training scenes")
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--test-scenes", type=int, default=12)
    parser.add_argument("--figures", type=Path, help="JSON file for the tables of the documentation")
    parser.add_argument("--curves", type=Path, help="JSON file of the training curves")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    views = _training_views(arguments.training, arguments.scenes, 0)
    networks: dict[str, Corrector] = {}
    curves: dict[str, list[float]] = {}
    for seed in arguments.seeds:
        begun = time.process_time()
        networks[f"seed {seed}"], curves[f"seed {seed}"] = train(views, seed, arguments.steps)
        minutes = (time.process_time() - begun) / 60
        print(f"seed {seed}: {minutes:.1f} processor minutes; error over the uncorrected map's, by tenths:")
        print("  " + " ".join(f"{x:.3f}" for x in curves[f"seed {seed}"]), flush=True)
    if arguments.curves:
        write_text(arguments.curves, json.dumps(curves, indent=1) + "\n")
    rows = score(arguments.test, arguments.test_scenes, networks)
    for name, row in rows.items():
        row["wrong"] = float(np.mean([row[kind] for kind in DEGRADED]))
        print(f"{name:10s}" + "".join(f"{kind} {value:6.2f}  " for kind, value in row.items()), flush=True)
    if arguments.figures:
        columns = {kind: (kind, ".2f") for kind in ("true", *DEGRADED, "wrong")}
        command = "python -m benchmarks.experiments.networks.train_through_rays TRAINING TEST"
        conditions = f"edge PSNR in dB, {len(views)} views in training, scenes of another kind in the test"
        write_figures(arguments.figures, command, conditions, columns, rows)


if __name__ == "__main__":
    main()

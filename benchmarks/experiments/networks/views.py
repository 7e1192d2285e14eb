"""Scenes of the trainings through the rays, with maps of depth estimators as the default repair leaves them.

Training: planes with photographs of the training, and stereo, plane-sweep, time-of-flight and lidar maps or
an augmented true map. Test: cluttered scenes with photographs that the training does not show, and all maps
of the repair benchmark.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmarks.quality.scenes.repair_faults import FAULTS
from benchmarks.quality.scenes.repair_material import CONFIG, ESTIMATORS, Scene, read_scene, read_scenes
from bokehnet.config import load_config
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.synth import SceneConfig, SynthConfig
from train.data.augmentation import augment_disparity
from train.scores.metrics import compare

__all__ = ["KINDS", "TrainingView", "busy_window", "mean_scores", "training_views"]

# Side of a crop in pixels, candidates of a crop, and the minimum difference of neighbours at a depth edge, as
# a fraction of the range; a crop without a depth edge teaches nothing.
_CROP_PX, _CANDIDATE_CROPS, _MIN_STEP = 64, 3, 0.03

_CLUTTER = Path(__file__).parents[3] / "configs" / "synth_clutter.toml"
_PHOTOGRAPHS = load_config(_CLUTTER, SynthConfig).scene.photographs
_TRAINING = replace(
    CONFIG,
    seed=4000037,
    kind="planes",
    scene=SceneConfig(light_probability=0.0, photographs=_PHOTOGRAPHS),
)

# Estimators of the training, and maps of each scene.
_TAUGHT = (
    *("plane sweep", "block matching", "semi-global matching", "time of flight", "lidar, linear"),
    "stereo noise",
)
_MAPS = 3

# Columns of the scores: title and maps. "wrong" is the mean of all that are not exact.
_ESTIMATED = (*_TAUGHT, "lidar, nearest", "missing bands", "outliers")
_COLUMNS: Mapping[str, Sequence[str]] = {
    "exact": ("exact",),
    "plane sweep": ("plane sweep",),
    "stereo": ("block matching", "semi-global matching"),
    "time of flight": ("time of flight",),
    "lidar": ("lidar, linear", "lidar, nearest"),
    "noise, gaps": ("stereo noise", "missing bands", "outliers"),
    "recipes": tuple(FAULTS),
    "wrong": (*_ESTIMATED, *FAULTS),
}
KINDS = tuple(_COLUMNS)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TrainingView:
    """Scene with a faulty map as the default repair leaves it, and the traced picture.

    Attributes:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        true: Exact disparity, (H, W).
        repaired: Repaired faulty disparity, (H, W).
        truth: Traced picture with bokeh, (H, W, 3).
        blur: Blur radius in pixels per unit of disparity.
        focus: Disparity in focus.
    """

    image: np.ndarray
    true: np.ndarray
    repaired: np.ndarray
    truth: np.ndarray
    blur: float
    focus: float

    def defocus(self, disparity: np.ndarray) -> np.ndarray:
        """Return the signed blur radius in pixels of a map, (H, W) float32."""
        return np.asarray(defocus_from_disparity(disparity, self.blur, self.focus), np.float32)


def _view(scene: Scene, wrong: np.ndarray, repair: DisparityRepair) -> TrainingView:
    return TrainingView(
        image=scene.image,
        true=scene.disparity,
        repaired=repair(scene.image, np.asarray(wrong, np.float32), "auto"),
        truth=scene.truth,
        blur=scene.blur,
        focus=scene.focus,
    )


def training_views(folder: Path, count: int, seed: int) -> list[TrainingView]:
    """Return views of ``count`` training scenes, each with some maps; ``folder`` is a cache of the scenes."""
    repair, rng, views = DisparityRepair(), np.random.default_rng(seed), []
    for number in tqdm(range(count), desc="training scenes", mininterval=10):
        scene = read_scene(folder, number, _TRAINING)
        for kind in rng.choice((*_TAUGHT, "augmented"), _MAPS, replace=False):
            if kind == "augmented":
                wrong = augment_disparity(scene.disparity, rng, scene.image)
            else:
                wrong = ESTIMATORS[kind](scene, rng)
            views.append(_view(scene, wrong, repair))
    return views


def busy_window(true: np.ndarray, rng: np.random.Generator) -> tuple[slice, slice]:
    """Return the window with the most depth edges of a few random ones."""
    edges = np.zeros(true.shape, bool)
    edges[1:] |= np.abs(np.diff(true, axis=0)) > _MIN_STEP * np.ptp(true)
    edges[:, 1:] |= np.abs(np.diff(true, axis=1)) > _MIN_STEP * np.ptp(true)
    tops, lefts = (rng.integers(side - _CROP_PX + 1, size=_CANDIDATE_CROPS) for side in true.shape)
    windows = [np.s_[y : y + _CROP_PX, x : x + _CROP_PX] for y, x in zip(tops, lefts, strict=True)]
    return max(windows, key=lambda window: int(edges[window].sum()))


def mean_scores(
    folder: Path, count: int, render: Callable[[TrainingView], dict[str, np.ndarray]]
) -> dict[str, dict[str, float]]:
    """Return the edge PSNR in dB by method and column of :data:`KINDS`, means over the test scenes.

    Args:
        folder: Cache of the scenes.
        count: Number of test scenes.
        render: Function that returns the pictures of all methods.
    """
    repair = DisparityRepair()
    scores: dict[str, dict[str, list[float]]] = {}
    for number, scene in enumerate(tqdm(read_scenes(folder, count), desc="scores", mininterval=10)):
        for kind in ("exact", *_COLUMNS["wrong"]):
            rng = np.random.default_rng(number)
            wrong = FAULTS[kind](scene.disparity, rng) if kind in FAULTS else ESTIMATORS[kind](scene, rng)
            view = _view(scene, wrong, repair)
            for name, bokeh in render(view).items():
                psnr = compare(bokeh, scene.truth, view.defocus(scene.disparity))["edge_psnr"]
                scores.setdefault(name, {}).setdefault(kind, []).append(psnr)
    return {
        name: {title: float(np.mean([row[kind] for kind in kinds])) for title, kinds in _COLUMNS.items()}
        for name, row in scores.items()
    }

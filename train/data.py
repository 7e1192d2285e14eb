"""Training examples: random crops of the pairs that ``bokehnet synth`` wrote, with the disparity spoilt."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import kornia
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from bokehnet.cascade import build_levels
from bokehnet.classical.base import make_classical
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.pyramid import count_halvings, downsample2
from bokehnet.synth.shards import ShardSet, TrainingSample

__all__ = ["DataConfig", "Example", "Examples", "example_loader", "spoil_disparity"]

# One example: "image", "classical", "truth" (3, H, W) scene-linear; "defocus" (1, H, W) pixels, from the
# spoilt disparity; "error_map" (1, H, W) geometric target; whole pairs also "extra_halvings", 0 or 1.
Example = dict[str, Tensor]

# Crops to choose from; where the error map is empty there is nothing to learn.
TRIES = 4


@dataclass(frozen=True, kw_only=True)
class DataConfig:
    """Where the pairs come from and what is done to them.

    Attributes:
        folder: Shards for training.
        validation: Shards for validation, of another seed.
        batch_size: Examples a step.
        workers: Loader processes; 0 loads in the training process.
        spoilt: Share of examples whose disparity is blurred, dilated or eroded before it is used.
        max_exposure: Light is scaled by 2 ** u, u uniform in [-max_exposure, max_exposure].
        coarse_crop: Side of the crops at ARNet's size, pixels.
        classical: The classical renderer whose result the networks correct.
    """

    folder: str
    validation: str
    batch_size: int = 8
    workers: int = 0
    spoilt: float = 0.35
    max_exposure: float = 1.0
    coarse_crop: int = 96
    classical: str = "scatter"


def spoil_disparity(disparity: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return ``disparity`` (H, W) as a depth network might have seen it: blurred, grown or shrunk edges.

    Source:
        The three corruptions of Peng et al., "BokehMe: When neural rendering meets classical rendering",
        CVPR 2022; their strengths are ours.
    """
    tensor = torch.from_numpy(disparity)[None, None]
    kind = rng.choice(["dilate", "erode", "blur"], p=[0.3, 0.3, 0.4])
    if kind == "blur":
        sigma = float(rng.uniform(0.5, 3.0))
        size = 2 * int(np.ceil(3 * sigma)) + 1
        tensor = kornia.filters.gaussian_blur2d(tensor, (size, size), (sigma, sigma), border_type="replicate")
    else:
        size = 2 * int(rng.integers(1, 4)) + 1
        grow = kornia.morphology.dilation if kind == "dilate" else kornia.morphology.erosion
        tensor = grow(tensor, torch.ones(size, size))
    return tensor[0, 0].numpy()


def _turned(array: np.ndarray, quarter_turns: int, mirrored: bool) -> np.ndarray:
    turned = np.rot90(array, quarter_turns)
    return np.ascontiguousarray(turned[:, ::-1] if mirrored else turned)


def make_example(
    sample: TrainingSample, view: int, rng: np.random.Generator | None, config: DataConfig
) -> Example:
    """Turn one view of a sample into an example at full size; without ``rng``, nothing is varied."""
    image = sample.image.astype(np.float32)
    truth = sample.bokeh[view].astype(np.float32)
    disparity = true_disparity = sample.disparity.astype(np.float32)
    if rng is not None:
        turns, mirrored = int(rng.integers(4)), bool(rng.integers(2))
        image, truth, disparity = (_turned(x, turns, mirrored) for x in (image, truth, disparity))
        gains = np.float32(2.0 ** rng.uniform(-config.max_exposure, config.max_exposure))
        order = rng.permutation(3)
        image, truth = gains * image[..., order], gains * truth[..., order]
        true_disparity = disparity
        if rng.random() < config.spoilt:
            disparity = spoil_disparity(disparity, rng)
    blur, focus = float(sample.blur[view]), float(sample.focus[view])
    defocus, true_defocus = (defocus_from_disparity(d, blur, focus) for d in (disparity, true_disparity))
    result = make_classical(config.classical)(image, defocus)
    target = result.error_map
    if true_disparity is not disparity:
        target = np.maximum(target, geometric_error_map(true_defocus))
    colours = {"image": image, "classical": result.bokeh, "truth": truth}
    example = {name: torch.from_numpy(x).permute(2, 0, 1).contiguous() for name, x in colours.items()}
    return example | {"defocus": torch.from_numpy(defocus)[None], "error_map": torch.from_numpy(target)[None]}


def coarse_example(example: Example, unit: float, crop: int, rng: np.random.Generator) -> Example:
    """Return a crop of the example at the size that ARNet works at: of a few, the one with most to mend."""
    halvings = count_halvings(float(example["defocus"].abs().max()), unit)
    keys = ("image", "defocus", "classical", "error_map")
    level = build_levels(*(example[key] for key in keys), halvings)[0]
    truth = example["truth"]
    for _ in range(halvings):
        truth = downsample2(truth)
    coarse = {
        "image": level.image,
        "defocus": level.defocus,
        "classical": level.classical,
        "error_map": level.doubt,
        "truth": truth,
    }
    height, width = coarse["image"].shape[-2:]
    tops = rng.integers(max(1, height - crop + 1), size=TRIES)
    lefts = rng.integers(max(1, width - crop + 1), size=TRIES)
    windows = [np.s_[:, top : top + crop, left : left + crop] for top, left in zip(tops, lefts, strict=True)]
    best = max(windows, key=lambda window: float(coarse["error_map"][window].sum()))
    return {name: x[best].contiguous() for name, x in coarse.items()}


class Examples(Dataset):
    """Example number i of an endless, fixed sequence: all that is random follows from (seed, i)."""

    def __init__(self, config: DataConfig, seed: int, length: int, unit: float | None = None) -> None:
        self.config, self.seed, self.length, self.unit = config, seed, length, unit
        self.samples = ShardSet(Path(config.folder))

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, index: int) -> Example:
        rng = np.random.default_rng([self.seed, index])
        sample = self.samples[int(rng.integers(len(self.samples)))]
        view = int(rng.integers(len(sample.blur)))
        example = make_example(sample, view, rng, self.config)
        if self.unit is None:
            return example | {"extra_halvings": torch.tensor(int(rng.integers(2)))}
        return coarse_example(example, self.unit, self.config.coarse_crop, rng)


def _one_thread(worker: int) -> None:
    import numba

    torch.set_num_threads(1)
    numba.set_num_threads(1)


def example_loader(
    config: DataConfig, *, seed: int, steps: int, first_step: int, unit: float | None = None
) -> DataLoader[Any]:
    """Batches ``first_step`` to ``steps`` of the sequence; a resumed run sees what it would have seen.

    Args:
        config: Data settings.
        seed: Seed of the sequence.
        steps: Length of the whole run.
        first_step: Steps already done.
        unit: Give coarse crops for ARNet with this unit; ``None`` gives whole pairs.
    """
    examples = Examples(config, seed, steps * config.batch_size, unit)
    indices = range(first_step * config.batch_size, len(examples))
    return DataLoader(
        examples,
        batch_size=config.batch_size,
        sampler=indices,
        num_workers=config.workers,
        multiprocessing_context="spawn" if config.workers else None,
        worker_init_fn=_one_thread if config.workers else None,
        prefetch_factor=4 if config.workers else None,
    )

"""Examples for the disparity repair: a picture, its true disparity and a degraded one."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bokehnet.synth.shards import TrainingSample
from train.data.augmentation import augment_disparity
from train.data.scene_pairs import HeldOut, ScenePairs

__all__ = ["RepairDataConfig", "busy_window", "held_out_repairs", "repair_pair", "repair_source"]


# Number of candidate crops; a crop without a depth edge teaches nothing.
CANDIDATE_CROPS = 3

# Minimum difference of neighbours at a depth edge, as a fraction of the map's range.
_MIN_STEP = 0.03


@dataclass(frozen=True, kw_only=True)
class RepairDataConfig:
    """Sources of the pictures and their augmentation.

    Attributes:
        folder: Shards for training.
        also: Further folders; all sets are equally likely.
        validation: Shards for validation, of another seed.
        batch_size: Examples per step.
        workers: Loader processes; 0 loads in the training process.
        clean: Fraction of examples with unchanged disparity.
        bent: Fraction of examples whose true and augmented disparity are both raised to a random power, as in
            relative disparity of unknown scale.
        crop: Side of the crops, pixels.
        part: Maximum side of a picture, pixels; a larger one is cropped to a random piece of this size.
    """

    folder: str
    validation: str
    batch_size: int = 16
    workers: int = 0
    clean: float = 0.2
    bent: float = 0.3
    crop: int = 128
    also: tuple[str, ...] = ()
    part: int = 256


def repair_pair(
    image: np.ndarray, disparity: np.ndarray, rng: np.random.Generator, config: RepairDataConfig
) -> dict[str, np.ndarray]:
    """Draw one example from a whole picture (H, W, 3) and its disparity (H, W)."""
    if max(disparity.shape) > config.part:
        piece = tuple(_random_piece(side, config.part, rng) for side in disparity.shape)
        image, disparity = image[piece], disparity[piece]
    turns, mirrored = int(rng.integers(4)), bool(rng.integers(2))
    image, disparity = np.rot90(image, turns), np.rot90(disparity, turns)
    if mirrored:
        image, disparity = image[:, ::-1], disparity[:, ::-1]
    low, high = float(disparity.min()), float(disparity.max())
    true = np.ascontiguousarray((disparity - low) / max(high - low, 1e-6), np.float32)
    if rng.random() < config.bent:
        true = true ** np.float32(2.0 ** rng.uniform(-1, 1))
    augmented = true if rng.random() < config.clean else augment_disparity(true, rng, image)
    span = max(float(augmented.max() - augmented.min()), 1e-6)
    window = busy_window(true, config.crop, rng)
    gain = np.float32(2.0 ** rng.uniform(-1, 1))
    colors = gain * image[window].astype(np.float32)[..., rng.permutation(3)]
    return {
        "image": np.ascontiguousarray(colors.transpose(2, 0, 1)),
        "disparity": np.ascontiguousarray(augmented[window])[None],
        "truth": np.ascontiguousarray(true[window])[None],
        "span": np.full((1, 1, 1), span, np.float32),
    }


def _random_piece(side: int, length: int, rng: np.random.Generator) -> slice:
    """Return a random slice of at most ``length`` of ``side`` pixels."""
    first = int(rng.integers(max(1, side - length + 1)))
    return slice(first, first + length)


def busy_window(true: np.ndarray, crop: int, rng: np.random.Generator) -> tuple[slice, slice]:
    """Return the window with the most depth edges of a few random ones."""
    height, width = true.shape
    threshold = _MIN_STEP * float(np.ptp(true))
    steps = np.zeros(true.shape, bool)
    steps[1:] |= np.abs(np.diff(true, axis=0)) > threshold
    steps[:, 1:] |= np.abs(np.diff(true, axis=1)) > threshold
    tops = rng.integers(max(1, height - crop + 1), size=CANDIDATE_CROPS)
    lefts = rng.integers(max(1, width - crop + 1), size=CANDIDATE_CROPS)
    windows = [np.s_[top : top + crop, left : left + crop] for top, left in zip(tops, lefts, strict=True)]
    return max(windows, key=lambda window: int(steps[window].sum()))


def _picture_and_map(sample: TrainingSample) -> tuple[np.ndarray, ...]:
    return sample.image, sample.disparity


def repair_source(config: RepairDataConfig) -> ScenePairs:
    """Return the source of training examples."""
    folders = (config.folder, *config.also)
    return ScenePairs(folders, _picture_and_map, partial(repair_pair, config=config))


def held_out_repairs(config: RepairDataConfig, count: int) -> HeldOut:
    """Return ``count`` whole held-out examples of the validation scenes."""

    def source_of(clean: float, crop: int) -> ScenePairs:
        return repair_source(replace(config, folder=config.validation, also=(), clean=clean, crop=crop))

    return HeldOut(source_of, count)

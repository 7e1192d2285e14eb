"""Examples for the disparity repair: a picture, its true disparity, and what was made of it."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bokehnet.synth.shards import TrainingSample
from train.augmentation import augment_disparity
from train.scene_pairs import HeldOut, ScenePairs

__all__ = ["RepairDataConfig", "busy_window", "held_out_repairs", "repair_pair", "repair_source"]


# Crops to choose from; where there is no step there is nothing to learn.
TRIES = 3

# A difference of neighbours that makes a step, as a share of the map's span.
_STEP = 0.03


@dataclass(frozen=True, kw_only=True)
class RepairDataConfig:
    """Where the pictures come from and what is done to them.

    Attributes:
        folder: Shards for training.
        also: Further sets of them; every set is as likely as the others.
        validation: Shards for validation, of another seed.
        batch_size: Examples a step.
        workers: Loader processes; 0 loads in the training process.
        clean: Share of examples whose disparity stays as it is.
        bent: Share whose disparity, true and augmented alike, goes through a power first, as relative
            disparity of unknown scale does.
        crop: Side of the crops, pixels.
        part: Largest side of what counts as a picture: of larger ones a random piece of that size does.
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
    """A piece of at most ``length`` of that many pixels."""
    first = int(rng.integers(max(1, side - length + 1)))
    return slice(first, first + length)


def busy_window(true: np.ndarray, crop: int, rng: np.random.Generator) -> tuple[slice, slice]:
    """Of a few random windows, the one with the most steps."""
    height, width = true.shape
    least = _STEP * float(np.ptp(true))
    steps = np.zeros(true.shape, bool)
    steps[1:] |= np.abs(np.diff(true, axis=0)) > least
    steps[:, 1:] |= np.abs(np.diff(true, axis=1)) > least
    tops = rng.integers(max(1, height - crop + 1), size=TRIES)
    lefts = rng.integers(max(1, width - crop + 1), size=TRIES)
    windows = [np.s_[top : top + crop, left : left + crop] for top, left in zip(tops, lefts, strict=True)]
    return max(windows, key=lambda window: int(steps[window].sum()))


def _picture_and_map(sample: TrainingSample) -> tuple[np.ndarray, ...]:
    return sample.image, sample.disparity


def repair_source(config: RepairDataConfig) -> ScenePairs:
    """Examples for training."""
    folders = (config.folder, *config.also)
    return ScenePairs(folders, _picture_and_map, partial(repair_pair, config=config))


def held_out_repairs(config: RepairDataConfig, count: int) -> HeldOut:
    """So many whole examples of the scenes for validation."""

    def source_of(clean: float, crop: int) -> ScenePairs:
        return repair_source(replace(config, folder=config.validation, also=(), clean=clean, crop=crop))

    return HeldOut(source_of, count)

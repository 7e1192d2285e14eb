"""Examples for EdgeNet: a picture, augmented disparity, and true disparities inside its pixels."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from bokehnet.errors import DataFileError
from bokehnet.inference.disparity_edges import sharpen_if_soft, soft_edge_fraction
from bokehnet.synth.shards import TrainingSample
from train.augmentation import augment_disparity
from train.repair_data import busy_window
from train.scene_pairs import HeldOut, ScenePairs

__all__ = ["EdgeDataConfig", "edge_pair", "edge_source", "held_out_edges"]

# Largest noise of a picture, of its encoded values, and the share of pictures that have some.
_NOISE, _NOISY = 0.03, 0.3


@dataclass(frozen=True, kw_only=True)
class EdgeDataConfig:
    """Where the pictures come from and what is done to them.

    Attributes:
        folder: Shards for training, with fine disparity.
        also: Further sets of them; every set is as likely as the others.
        validation: Shards for validation, of another seed.
        batch_size: Examples a step.
        workers: Loader processes; 0 loads in the training process.
        clean: Share of examples whose disparity stays as it is.
        bent: Share whose disparity, true and augmented alike, goes through a power first, as relative
            disparity of unknown scale does.
        crop: Side of the crops, pixels.
        around: Pixels around a crop that are augmented with it.
        samples: True disparities inside each pixel that an example holds.
    """

    folder: str
    validation: str
    batch_size: int = 4
    workers: int = 0
    clean: float = 0.3
    bent: float = 0.3
    crop: int = 192
    around: int = 24
    also: tuple[str, ...] = ()
    samples: int = 6


def edge_pair(
    image: np.ndarray,
    disparity: np.ndarray,
    fine: np.ndarray,
    rng: np.random.Generator,
    config: EdgeDataConfig,
) -> dict[str, np.ndarray]:
    """Draw one example from a whole picture (H, W, 3), its disparity (H, W) and fine disparity (k H, k W)."""
    factor = fine.shape[0] // disparity.shape[0]
    inside = fine.reshape(disparity.shape[0], factor, disparity.shape[1], factor)
    inside = inside.transpose(0, 2, 1, 3).reshape(*disparity.shape, -1)
    window = busy_window(disparity, config.crop, rng)
    larger = tuple(slice(max(0, s.start - config.around), s.stop + config.around) for s in window)
    inner = tuple(
        slice(s.start - large.start, s.stop - large.start) for s, large in zip(window, larger, strict=True)
    )
    image, disparity, inside = (x[larger].astype(np.float32) for x in (image, disparity, inside))
    low, high = float(disparity.min()), float(disparity.max())
    true, inside = ((x - low) / max(high - low, 1e-6) for x in (disparity, inside))
    if rng.random() < config.bent:
        power = np.float32(2.0 ** rng.uniform(-1, 1))
        true, inside = true**power, np.maximum(inside, 0) ** power
    augmented = true if rng.random() < config.clean else augment_disparity(true, rng, image)
    augmented = sharpen_if_soft(augmented, soft_edge_fraction(augmented))
    span = max(float(augmented.max() - augmented.min()), 1e-6)
    chosen = rng.permutation(inside.shape[-1])[: config.samples]
    gain = np.float32(2.0 ** rng.uniform(-1, 1))
    colors = gain * image[inner][..., rng.permutation(3)]
    if rng.random() < _NOISY:
        noise = np.float32(rng.uniform(0, _NOISE)) * rng.standard_normal(colors.shape).astype(np.float32)
        colors = np.maximum(colors + 2 * np.sqrt(np.clip(colors, 1e-4, 1)) * noise, 0)
    turns, mirrored = int(rng.integers(4)), bool(rng.integers(2))

    def turned(x: np.ndarray) -> np.ndarray:
        """Channels first."""
        x = np.rot90(x, turns)
        x = x[:, ::-1] if mirrored else x
        return np.ascontiguousarray(x.transpose(2, 0, 1), np.float32)

    return {
        "image": turned(colors),
        "disparity": turned(augmented[inner][..., None]),
        "truth": turned(true[inner][..., None]),
        "inside": turned(inside[inner][..., chosen]),
        "span": np.full((1, 1, 1), span, np.float32),
    }


def _picture_and_maps(sample: TrainingSample) -> tuple[np.ndarray, ...]:
    return sample.image, sample.disparity, sample.fine_disparity


def edge_source(config: EdgeDataConfig) -> ScenePairs:
    """Examples for training.

    Raises:
        DataFileError: No shards are there, nothing of them can be read, or they hold no fine disparity.
    """
    source = ScenePairs((config.folder, *config.also), _picture_and_maps, partial(edge_pair, config=config))
    for samples in source.sets:
        if not samples.description.get("fine"):
            raise DataFileError(
                f"{samples.folder}: expected fine disparity, found none; make the set with `fine` = 4"
            )
    return source


def held_out_edges(config: EdgeDataConfig, count: int) -> HeldOut:
    """So many large examples of the scenes for validation."""

    def source_of(clean: float, crop: int) -> ScenePairs:
        return edge_source(replace(config, folder=config.validation, also=(), clean=clean, crop=crop))

    return HeldOut(source_of, count)

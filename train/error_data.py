"""Examples for ErrorNet: what three ways to render make of a view, what is known of it, and the truth.

``python -m train.error_data --config configs/prepare_error.toml --out data/error``

Half of them, by default, are given a map that is wrong and was repaired, as people's maps are. A killed run
goes on where it stopped and gives the same bytes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import uniform_filter
from torch import Tensor

from bokehnet.classical.rays_renderer import rays, render_rays
from bokehnet.errors import DataFileError
from bokehnet.inference.engine import Engine
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.synth.shards import ShardSet, TrainingSample
from train.data import CropsConfig, best_window
from train.examples import Skips
from train.prepare import packed, prepare_command, scene_examples, write_parts
from train.prepared import PreparedSet

__all__ = ["ERROR_PLANES", "ErrorCrops", "ErrorDataConfig", "ErrorSetConfig", "main", "prepare_errors"]

# What is where in an example, (planes, H, W), float16.
ERROR_PLANES = {
    "image": slice(0, 3),
    "rays": slice(3, 6),
    "scatter": slice(6, 9),
    "neural": slice(9, 12),
    "truth": slice(12, 15),
    "features": slice(15, 19),
}
_COUNT = 19

# Side of the windows over which the rays' noise is averaged, pixels.
_WINDOW = 5

# The error map among the planes: where rays run, and where errors are looked for.
_ERROR_MAP = 18


@dataclass(frozen=True, kw_only=True)
class ErrorSetConfig:
    """What a set of examples is made of.

    Attributes:
        folder: Shards of ``bokehnet synth``.
        augmented: Examples with an augmented disparity for each view, beside the one with the true one.
        repair: Folder of the repair's weights; empty leaves augmented disparity as it is.
        neural: Folder of the networks whose picture is the third candidate.
        seed: Of what is augmented and how.
        scenes_per_part: Scenes in one file.
    """

    folder: str
    augmented: int = 1
    repair: str = "bokehnet/weights/repair"
    neural: str = "bokehnet/weights/fast"
    seed: int = 0
    scenes_per_part: int = 25


@lru_cache(maxsize=1)
def _engine(folder: str) -> Engine:
    return Engine("fast", weights=Path(folder), threads=1)


def rays_noise(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Standard deviation of the noise of one render, by two that differ by it alone.

    Args:
        first: Render (H, W, 3).
        second: The same with another seed.

    Returns:
        (H, W), the root of the variance that is averaged over a small window and the colours: half the mean
        square of the difference.
    """
    variance = 0.5 * ((first - second) ** 2).mean(-1)
    return np.sqrt(np.maximum(uniform_filter(variance, _WINDOW, mode="nearest"), 0))


def error_example(sample: TrainingSample, view: int, disparity: np.ndarray, neural: str) -> np.ndarray:
    """All of one view with ``disparity`` (H, W) in place of the true one; (planes, H, W) float16."""
    image = sample.image.astype(np.float32)
    defocus = defocus_from_disparity(disparity, float(sample.blur[view]), float(sample.focus[view]))
    found = render_rays(image, defocus)
    other = _engine(neural).render(image, defocus)
    weight = found.disocclusion_weight
    assert other.neural is not None
    assert weight is not None
    features = [defocus, rays_noise(found.bokeh, rays(image, defocus, seed=1)), weight, found.error_map]
    parts = {
        "image": image,
        "rays": found.bokeh,
        "scatter": other.classical,
        "neural": other.neural,
        "truth": sample.bokeh[view],
        "features": np.stack(features, -1),
    }
    return packed(parts, ERROR_PLANES, _COUNT)


def _scene(config: ErrorSetConfig, samples: ShardSet, number: int) -> list[np.ndarray] | DataFileError:
    return scene_examples(config, samples, number, partial(error_example, neural=config.neural))


def prepare_errors(config: ErrorSetConfig, out: Path, workers: int = 1) -> None:
    """Write all parts that are missing; arguments and errors of :func:`train.prepare.prepare`."""
    write_parts(config, out, workers, _scene, _COUNT)


@dataclass(frozen=True, kw_only=True)
class ErrorDataConfig(CropsConfig):
    """Where the examples come from and what is done to them.

    Attributes:
        crop: Side of the crops, pixels, a multiple of 8.
    """

    crop: int = 96


class ErrorCrops:
    """Draws crops of what :func:`prepare_errors` wrote: a tensor for each of ``ERROR_PLANES``."""

    def __init__(self, config: ErrorDataConfig) -> None:
        self.config = config
        skips = Skips()
        folders = (config.folder, *config.also)
        self.sets = [PreparedSet(folder, on_damage=skips, planes=_COUNT) for folder in folders]

    def draw(self, rng: np.random.Generator) -> dict[str, Tensor]:
        """Draw one example."""
        prepared = self.sets[int(rng.integers(len(self.sets)))]
        planes = prepared[int(rng.integers(len(prepared)))]
        window = best_window(planes[_ERROR_MAP].astype(np.float32), 0, self.config.crop, rng)
        part = np.rot90(planes[:, *window].astype(np.float32), int(rng.integers(4)), axes=(1, 2))
        part = part[:, :, ::-1] if rng.random() < 0.5 else part
        return split_planes(part, 2.0 ** (self.config.max_exposure * rng.uniform(-1, 1)), rng.permutation(3))


def split_planes(
    planes: np.ndarray, gain: float = 1.0, order: Sequence[int] | np.ndarray = (0, 1, 2)
) -> dict[str, Tensor]:
    """Tensors by name of planes (planes, H, W), light scaled by ``gain`` and colours in another order."""
    example = {}
    for name, place in ERROR_PLANES.items():
        part = planes[place]
        if name == "features":
            part = part * np.array([1, gain, 1, 1], np.float32)[:, None, None]  # noise is light, too
        else:
            part = np.float32(gain) * part[list(order)]
        example[name] = torch.from_numpy(np.ascontiguousarray(part, np.float32))
    return example


def main(words: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    prepare_command(__doc__, ErrorSetConfig, prepare_errors, words)


if __name__ == "__main__":
    main()

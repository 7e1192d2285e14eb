"""Training examples for ARNet and IUNet: random crops of prepared examples."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bokehnet.arrays.pyramid import count_halvings, downsample2
from bokehnet.errors import DataFileError, ParameterError
from train.data.examples import Skips
from train.data.prepared import PLANES, PreparedSet

__all__ = ["CropsConfig", "DataConfig", "PreparedCrops", "best_window"]

# Number of candidate crops; a crop with an empty error map teaches nothing.
CANDIDATE_CROPS = 4


@dataclass(frozen=True, kw_only=True)
class CropsConfig:
    """Sources of prepared examples and how to draw from them.

    Attributes:
        folder: Prepared examples for training.
        also: Further folders; all sets are equally likely.
        validation: Prepared examples for validation, of other scenes.
        batch_size: Examples per step.
        workers: Loader processes; 0 loads in the training process.
        max_exposure: Scales light by 2 ** u with u uniform in [-max_exposure, max_exposure].
    """

    folder: str
    validation: str
    batch_size: int = 8
    workers: int = 0
    max_exposure: float = 1.0
    also: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class DataConfig(CropsConfig):
    """Sources of the examples and their augmentation.

    Attributes:
        augmented: Fraction of examples with augmented disparity, where the set holds such examples.
        coarse_crop: Side of ARNet's crops, pixels at its working resolution.
        fine_crop: Side of IUNet's crops, pixels at full resolution.
        most_halvings: Maximum number of halvings of ARNet's crops, so that they stay large enough; the
            network then sees somewhat more blur than its design radius.
        extra_halvings: Maximum number of random halvings of ARNet's crops beyond those that their blur
            requires, so that training covers all scales.
    """

    augmented: float = 0.5
    coarse_crop: int = 96
    fine_crop: int = 192
    most_halvings: int = 1
    extra_halvings: int = 0


def _halved(array: np.ndarray, times: int) -> np.ndarray:
    for _ in range(times):
        array = downsample2(array)
    return array


def best_window(
    classical_error_map: np.ndarray, halvings: int, crop: int, rng: np.random.Generator
) -> tuple[slice, slice]:
    """Return the window with most errors of a few random ones of ``crop`` halved pixels, at full size."""
    small = _halved(classical_error_map, halvings)
    height, width = small.shape
    tops = rng.integers(max(1, height - crop + 1), size=CANDIDATE_CROPS)
    lefts = rng.integers(max(1, width - crop + 1), size=CANDIDATE_CROPS)
    pairs = list(zip(tops, lefts, strict=True))
    sums = [float(small[top : top + crop, left : left + crop].sum()) for top, left in pairs]
    top, left = pairs[int(np.argmax(sums))]
    size = 2**halvings
    return slice(size * top, size * (top + crop)), slice(size * left, size * (left + crop))


class PreparedCrops:
    """Source of random crops of prepared examples.

    Each example is a dict of tensors: "image", "classical", "truth" (3, h, w), scene-linear; "defocus" (1, h,
        w),
    pixels of the crop; "features" (5, h, w); "classical_error_map" and "target" (1, h, w), the regions where
    the classical render can be wrong according to the given and to the true disparity. Crops at full size
    also have "extra_halvings", 0 or 1.

    Args:
        config: Data settings.
        network_max_radius: Halve the crops until their blur is within this radius, pixels; ``None`` keeps
            full size.

    Raises:
        DataFileError: No prepared examples exist, or they are of several classical renderers.
        ParameterError: Crops are larger than their pictures.
    """

    def __init__(self, config: DataConfig, network_max_radius: float | None = None) -> None:
        self.config, self.network_max_radius = config, network_max_radius
        skips = Skips()
        self.sets = [PreparedSet(folder, on_damage=skips) for folder in (config.folder, *config.also)]
        if len(renderers := {prepared.classical for prepared in self.sets}) > 1:
            raise DataFileError(
                "folder and also: expected examples of one classical renderer, found "
                f"{', '.join(sorted(renderers))}"
            )

        smallest_side = min(min(prepared[0].shape[1:]) for prepared in self.sets)
        fine = network_max_radius is None
        side = config.fine_crop if fine else config.coarse_crop * 2**config.most_halvings
        if side > smallest_side:
            name = "fine_crop" if fine else "coarse_crop"
            expected = f"at most {smallest_side} pixels at full size, the side of the smallest picture"
            raise ParameterError(f"data.{name}", expected, getattr(config, name), shown=str(side))

    def draw(self, rng: np.random.Generator) -> dict[str, Tensor]:
        """Draw one example."""
        prepared = self.sets[int(rng.integers(len(self.sets)))]
        view = int(rng.integers(len(prepared) // prepared.per_view))
        augmented = prepared.per_view > 1 and rng.random() < self.config.augmented
        other = int(rng.integers(1, prepared.per_view)) if augmented else 0
        arrays = prepared[view * prepared.per_view + other]
        halvings, crop = 0, self.config.fine_crop
        if self.network_max_radius is not None:
            largest = float(np.abs(arrays[PLANES["defocus"]]).max())
            halvings = count_halvings(largest, self.network_max_radius) + int(
                rng.integers(self.config.extra_halvings + 1)
            )
            halvings = min(halvings, self.config.most_halvings)
            crop = self.config.coarse_crop
        classical_error_map = arrays[PLANES["target"]][0].astype(np.float32)
        rows, columns = best_window(classical_error_map, halvings, crop, rng)
        window = _halved(arrays[:, rows, columns].astype(np.float32), halvings)
        window[PLANES["defocus"]] /= 2**halvings
        turns, mirrored = int(rng.integers(4)), bool(rng.integers(2))
        window = np.rot90(window, turns, axes=(1, 2))
        window = np.ascontiguousarray(window[:, :, ::-1] if mirrored else window)
        gain, order = np.float32(2.0 ** (self.config.max_exposure * rng.uniform(-1, 1))), rng.permutation(3)
        example = {}
        for name, planes in PLANES.items():
            part = window[planes]
            colored = len(part) == 3
            example[name] = torch.from_numpy(gain * part[order] if colored else part)
        example["features"] = torch.cat(
            [
                example.pop("occluded_background"),
                example.pop("disocclusion_weight"),
                example["classical_error_map"],
            ]
        )
        if self.network_max_radius is None:
            example["extra_halvings"] = torch.tensor(int(rng.integers(2)))
        return example

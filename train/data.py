"""Training examples for ARNet and IUNet: random crops of what ``train.prepare`` wrote."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bokehnet.arrays.pyramid import count_halvings, downsample2
from bokehnet.errors import DataFileError, ParameterError
from train.examples import Skips
from train.prepared import PLANES, PreparedSet

__all__ = ["CropsConfig", "DataConfig", "PreparedCrops", "best_window"]

# Crops to choose from; where the error map is empty there is nothing to learn.
TRIES = 4


@dataclass(frozen=True, kw_only=True)
class CropsConfig:
    """Where prepared examples come from and how they are drawn.

    Attributes:
        folder: Prepared examples for training.
        also: Further sets of them; every set is as likely as the others.
        validation: Prepared examples for validation, of other scenes.
        batch_size: Examples a step.
        workers: Loader processes; 0 loads in the training process.
        max_exposure: Light is scaled by 2 ** u, u uniform in [-max_exposure, max_exposure].
    """

    folder: str
    validation: str
    batch_size: int = 8
    workers: int = 0
    max_exposure: float = 1.0
    also: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class DataConfig(CropsConfig):
    """Where the examples come from and what is done to them.

    Attributes:
        augmented: Share of examples with an augmented disparity, where the set holds such.
        coarse_crop: Side of ARNet's crops, pixels at the size that it works at.
        fine_crop: Side of IUNet's crops, pixels at the full size.
        most_halvings: ARNet's crops are halved at most this often, so that they stay large enough; it then
            sees somewhat more blur than it is made for.
        extra_halvings: ARNet's crops are halved up to this many times more than their blur asks for: pictures
            of all sizes are seen at all sizes.
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
    """Of a few random windows of ``crop`` pixels at the halved size, the one with most errors, full size."""
    small = _halved(classical_error_map, halvings)
    height, width = small.shape
    tops = rng.integers(max(1, height - crop + 1), size=TRIES)
    lefts = rng.integers(max(1, width - crop + 1), size=TRIES)
    pairs = list(zip(tops, lefts, strict=True))
    sums = [float(small[top : top + crop, left : left + crop].sum()) for top, left in pairs]
    top, left = pairs[int(np.argmax(sums))]
    size = 2**halvings
    return slice(size * top, size * (top + crop)), slice(size * left, size * (left + crop))


class PreparedCrops:
    """Draws crops of what ``train.prepare`` wrote.

    Each is a dict of tensors: "image", "classical", "truth" (3, h, w), scene-linear; "defocus" (1, h, w),
    pixels of that size; "features" (5, h, w); "classical_error_map" and "target" (1, h, w), where the
    classical render can be wrong by its own account and by the true disparity. Crops at full size have
    "extra_halvings", 0 or 1.

    Args:
        config: Data settings.
        network_max_radius: Give crops at the size at which blur is within this radius; ``None`` gives crops
            at full size.

    Raises:
        DataFileError: No prepared examples are there, or they are of several classical renderers.
        ParameterError: Crops are larger than their pictures.
    """

    def __init__(self, config: DataConfig, network_max_radius: float | None = None) -> None:
        self.config, self.network_max_radius = config, network_max_radius
        skips = Skips()
        self.sets = [PreparedSet(folder, on_damage=skips) for folder in (config.folder, *config.also)]
        if len(bases := {prepared.classical for prepared in self.sets}) > 1:
            raise DataFileError(
                "folder and also: expected examples of one classical renderer, found "
                f"{', '.join(sorted(bases))}"
            )

        least = min(min(prepared[0].shape[1:]) for prepared in self.sets)
        fine = network_max_radius is None
        side = config.fine_crop if fine else config.coarse_crop * 2**config.most_halvings
        if side > least:
            name = "fine_crop" if fine else "coarse_crop"
            expected = f"at most {least} pixels of full size, as the smallest pictures have"
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

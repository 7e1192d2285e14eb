"""Examples for ErrorNet: crops of examples prepared with the rays, and the scatter of each crop."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bokehnet.arrays.pyramid import downsample2
from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.scatter_renderer import scatter_beyond
from bokehnet.errors import DataFileError
from bokehnet.models.error import FEATURES
from bokehnet.optics.aperture import Aperture
from train.data.crops import CropsConfig, best_window
from train.data.examples import Skips
from train.data.prepared import PLANES, PreparedSet

__all__ = ["ERROR_PARTS", "ErrorCrops", "ErrorDataConfig", "as_tensors", "error_parts"]

# Parts of an example besides the scatter, and the planes of each.
ERROR_PARTS = {
    "image": ("image",),
    "rays": ("classical",),
    "truth": ("truth",),
    "features": ("defocus", "disocclusion_weight", "classical_error_map"),
}


@dataclass(frozen=True, kw_only=True)
class ErrorDataConfig(CropsConfig):
    """Sources of the examples and their augmentation.

    Attributes:
        crop: Side of the crops, pixels, a multiple of 8.
        halved: Fraction of crops drawn at twice the size and halved, as large pictures are in use.
    """

    crop: int = 96
    halved: float = 0.3


def error_parts(planes: np.ndarray, rows: slice, columns: slice) -> dict[str, np.ndarray]:
    """Return ``ERROR_PARTS`` and the scatter, (C, h, w), of a window of an example (planes, H, W)."""
    height, width = planes.shape[1:]
    reach = math.ceil(float(np.abs(planes[PLANES["defocus"]]).max()))
    extended = [
        slice(max(0, side.start - reach), min(length, side.stop + reach))
        for side, length in ((rows, height), (columns, width))
    ]
    inner = tuple(
        slice(side.start - outer.start, side.stop - outer.start)
        for side, outer in zip((rows, columns), extended, strict=True)
    )
    outer = planes[:, *extended].astype(np.float32)
    image = np.ascontiguousarray(outer[PLANES["image"]].transpose(1, 2, 0))
    viewport = Viewport.whole(*image.shape[:2])
    scatter = scatter_beyond(image, outer[PLANES["defocus"]][0], Aperture(), reach, None, viewport)
    window = outer[:, *inner]
    parts = {
        name: np.concatenate([window[PLANES[plane]] for plane in names])
        for name, names in ERROR_PARTS.items()
    }
    return {**parts, "scatter": scatter[inner].transpose(2, 0, 1)}


def as_tensors(
    parts: dict[str, np.ndarray], gain: float = 1.0, order: Sequence[int] | np.ndarray = (0, 1, 2)
) -> dict[str, Tensor]:
    """Return tensors by name, with light scaled by ``gain`` and colours permuted by ``order``."""
    pictures = ("image", "rays", "scatter", "truth")
    scaled = {
        name: np.float32(gain) * part[list(order)] if name in pictures else part
        for name, part in parts.items()
    }
    return {name: torch.from_numpy(np.ascontiguousarray(part)) for name, part in scaled.items()}


def _halved(parts: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    parts = {name: downsample2(part) for name, part in parts.items()}
    parts["features"][FEATURES.index("defocus")] /= 2  # pixels
    return parts


class ErrorCrops:
    """Source of random crops of prepared examples.

    Each example is a dict of tensors: "image", "rays", "scatter", "truth" (3, h, w), scene-linear; "features"
        (3, h, w), the input of :class:`bokehnet.models.error.ErrorNet`.

    Raises:
        DataFileError: No prepared examples exist, or they are not of the rays.
    """

    def __init__(self, config: ErrorDataConfig) -> None:
        self.config = config
        skips = Skips()
        self.sets = [PreparedSet(folder, on_damage=skips) for folder in (config.folder, *config.also)]
        for prepared in self.sets:
            if prepared.classical != "rays":
                raise DataFileError(
                    f"{prepared.folder}: expected examples of the rays, found those of {prepared.classical}; "
                    'run python -m train.prepare with classical = "rays"'
                )

    def draw(self, rng: np.random.Generator) -> dict[str, Tensor]:
        """Draw one example."""
        prepared = self.sets[int(rng.integers(len(self.sets)))]
        planes = prepared[int(rng.integers(len(prepared)))]
        halvings = int(rng.random() < self.config.halved)
        window = best_window(planes[PLANES["target"]][0].astype(np.float32), halvings, self.config.crop, rng)
        parts = error_parts(planes, *window)
        parts = _halved(parts) if halvings else parts
        turns, mirrored = int(rng.integers(4)), bool(rng.integers(2))
        parts = {name: np.rot90(part, turns, axes=(1, 2)) for name, part in parts.items()}
        parts = {name: part[:, :, ::-1] if mirrored else part for name, part in parts.items()}
        return as_tensors(parts, 2.0 ** (self.config.max_exposure * rng.uniform(-1, 1)), rng.permutation(3))

"""Prepared examples on disk: memory-mapped arrays, so that a crop reads only its own pixels."""

import json
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np

from bokehnet.config import renamed
from bokehnet.engine_registry import CLASSICAL
from bokehnet.errors import ConfigError, DataFileError

__all__ = ["DESCRIPTION", "NUM_PLANES", "PLANES", "PreparedSet", "check_features", "part_name"]

# Planes of an example (NUM_PLANES, H, W), float16.
PLANES = {
    "image": slice(0, 3),
    "classical": slice(3, 6),
    "truth": slice(6, 9),
    "occluded_background": slice(9, 12),
    "defocus": slice(12, 13),
    "disocclusion_weight": slice(13, 14),
    "classical_error_map": slice(14, 15),
    "target": slice(15, 16),
}
NUM_PLANES = 16

DESCRIPTION = "prepared.json"


def check_features(see_features: bool, classical: str) -> None:
    """Raise unless a classical renderer provides the features that a network receives.

    Args:
        see_features: Option of the network.
        classical: Name of the classical renderer of its examples.

    Raises:
        ConfigError: Only renderers that trace rays provide features.
    """
    if see_features and not CLASSICAL[classical].traces_rays:
        raise ConfigError(
            f"model.see_features: expected false for examples of {classical}, which provides no features, "
            'found true; set it to false, or prepare examples with classical = "rays"'
        )


def part_name(number: int) -> str:
    """Return the file name of one part of a set, an array (examples, NUM_PLANES, H, W)."""
    return f"part-{number:06d}.npy"


@lru_cache(maxsize=64)
def _open(path: str) -> np.ndarray:
    array: np.ndarray = np.load(path, mmap_mode="r")
    return array


class PreparedSet:
    """Examples of a folder, by index; picklable.

    Attributes:
        per_view: Number of examples per view: the first has the true disparity, the others augmented ones.
        classical: Name of their classical renderer.

    Args:
        folder: Folder that ``train.prepare`` wrote.
        on_damage: Called with the error of an unreadable part, which is then skipped; default: raise it.

    Raises:
        DataFileError: The folder holds no complete set, or one of another version.
    """

    def __init__(
        self,
        folder: str | Path,
        on_damage: Callable[[DataFileError], None] | None = None,
    ) -> None:
        self.folder = Path(folder)
        description = self.folder / DESCRIPTION
        try:
            content = json.loads(description.read_text(encoding="utf-8"))
            config = renamed(content["config"])
            parts, self.per_view = int(content["parts"]), 1 + int(config["augmented"])
            self.classical = str(config.get("classical", "rays"))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise DataFileError(
                f"{description}: expected the description of prepared examples ({error}); "
                f"run python -m train.prepare"
            ) from error
        self._locations: list[tuple[str, int]] = []
        for number in range(parts):
            path = self.folder / part_name(number)
            try:
                array = _open(str(path))
            except (OSError, ValueError) as error:
                missing = isinstance(error, FileNotFoundError)
                remedy = ("" if missing else "remove it and ") + "run python -m train.prepare again"
                problem = DataFileError(f"{path}: expected prepared examples ({error}); {remedy}")
                if missing or on_damage is None:
                    raise problem from error
                on_damage(problem)
                continue
            if array.ndim != 4 or array.shape[1] != NUM_PLANES:
                raise DataFileError(
                    f"{path}: expected examples of {NUM_PLANES} planes, found shape {array.shape}; "
                    "prepare the set again in another folder"
                )
            self._locations += [(str(path), i) for i in range(len(array))]
        if not self._locations:
            raise DataFileError(f"{self.folder}: expected prepared examples, found none that can be read")

    def __len__(self) -> int:
        return len(self._locations)

    def __getitem__(self, number: int) -> np.ndarray:
        """Return example ``number``, (NUM_PLANES, H, W) float16, read-only."""
        path, index = self._locations[number]
        example: np.ndarray = _open(path)[index]
        return example

"""Examples for LightNet: regions of traced scenes that random cameras have clipped, with their true light."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.fft import dctn, idctn
from scipy.ndimage import gaussian_filter
from torch import Tensor

from bokehnet.errors import DataFileError
from bokehnet.io.files.atomic import write_atomic
from train.data.light_regions import measured_regions
from train.data.light_scenes import LIGHT, CameraCurve, decoded, light_picture, with_halo

__all__ = ["LightDataConfig", "LightExamples", "LightScenesConfig", "held_out_regions", "make_scene"]

# Quantisation of the brightness of an 8x8 block at quality 50 (ITU-T T.81, table K.1), first column and row:
# steps grow with the frequency. Their sum approximates the table to a third.
_STEPS_50 = np.add.outer(*[np.array([8, 7, 8, 10, 14, 20, 28, 33]) * 1.0] * 2)

# Number of regions that an example holds, all of one picture.
_REGIONS = 16

# Radius at which regions are sampled by the area of their discs, pixels.
_SAMPLING_RADIUS_PX = 12.0


@dataclass(frozen=True, kw_only=True)
class LightScenesConfig:
    """Scenes of a set of examples.

    Attributes:
        kinds: Keys of ``LIGHT`` or ``MATTER``.
        scenes: Number of scenes, of the kinds in turn.
        cameras: Number of cameras that store each scene.
        seed: Seed of the set.
    """

    kinds: tuple[str, ...]
    scenes: int
    cameras: int = 4
    seed: int = 1


@dataclass(frozen=True, kw_only=True)
class LightDataConfig:
    """Sources of the examples.

    Attributes:
        folder: Set for training, made by ``train.prepare_light``.
        validation: Set for validation, of another seed.
        batch_size: Pictures per step, each with 16 of its regions.
        workers: Loader processes; 0 loads in the training process.
    """

    folder: str
    validation: str
    batch_size: int = 16
    workers: int = 0


def make_scene(number: int, config: LightScenesConfig, path: Path) -> None:
    """Trace a scene, store it by random cameras and write the regions of all pictures."""
    rng = np.random.default_rng([config.seed, number])
    kind = config.kinds[number % len(config.kinds)]
    scale = int(rng.choice([1, 2, 3], p=[0.72, 0.22, 0.06]))
    image, disparity = light_picture(kind, rng, number, scale)
    near = disparity if rng.random() < 0.8 else None
    parts = [_stored_regions(image, near, rng) for _ in range(config.cameras)]
    parts = [part for part in parts if part is not None]
    names = ("features", "stored", "true", "surround", "area")
    columns = {
        name: np.concatenate([part[name] for part in parts]) if parts else np.zeros(0) for name in names
    }
    sizes = np.array([len(part["area"]) for part in parts], np.int64)

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:
            np.savez(file, sizes=sizes, is_light=np.array(kind in LIGHT), **columns)

    write_atomic(path, write, error=DataFileError)


def _stored_regions(
    image: np.ndarray, nearness: np.ndarray | None, rng: np.random.Generator
) -> dict[str, np.ndarray] | None:
    light = image * np.exp2(rng.normal(0, 0.5)) * np.exp2(rng.normal(0, 0.12, 3))
    if rng.random() < 0.6:
        light = with_halo(light, float(rng.uniform(0.1, 1.5)))
    if rng.random() < 0.4:  # the point spread function of a lens or of the demosaicking
        light = gaussian_filter(light, (*[float(rng.uniform(0.3, 1.2))] * 2, 0))
    original = decoded(_noisy(light, rng))
    measured = measured_regions(original, nearness)
    if measured is None:
        return None
    true = measured.regions.sums(light.astype(np.float32))
    return {
        "features": measured.features,
        "stored": measured.stored.astype(np.float32),
        "true": np.maximum(true, measured.stored).astype(np.float32),
        "surround": measured.surround.astype(np.float32),
        "area": measured.regions.pixels.sums().astype(np.float32),
    }


def _noisy(light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the picture (H, W, 3) uint8 that a random camera stores of light."""
    curve = CameraCurve()
    if rng.random() < 0.6:
        white = float(rng.uniform(1.2, 4))
        curve = CameraCurve(
            shoulder=float(rng.uniform(0.35, 0.9)), top=int(rng.integers(249, 256)), white=white
        )
    veil = gaussian_filter(light, (12, 12, 0)) if rng.random() < 0.3 else light
    glare = 10 ** rng.uniform(-3, -1.5)
    light = (1 - glare) * light + glare * veil
    shot, read = 10 ** rng.uniform(-4.5, -2.5), 10 ** rng.uniform(-4, -2.7)
    noise = np.sqrt(shot * np.minimum(light, 4)) + read
    codes = curve.store((light + noise * rng.standard_normal(light.shape)).clip(0))
    return _jpeg(codes, int(rng.integers(75, 99))) if rng.random() < 0.5 else codes


def _jpeg(codes: np.ndarray, quality: int) -> np.ndarray:
    """Return a picture after quantisation of its 8x8 blocks, as a JPEG file of a quality does."""
    scale = (5000 / quality if quality < 50 else 200 - 2 * quality) / 100
    steps = np.maximum(np.round(scale * _STEPS_50), 1)
    matrix = np.array([[0.299, 0.587, 0.114], [-0.169, -0.331, 0.5], [0.5, -0.419, -0.081]])
    height, width = (side - side % 8 for side in codes.shape[:2])
    values = (codes[:height, :width] - 128.0) @ matrix.T
    blocks = values.reshape(height // 8, 8, width // 8, 8, 3).transpose(0, 2, 4, 1, 3)
    quantised = idctn(
        np.round(dctn(blocks, axes=(3, 4), norm="ortho") / steps) * steps, axes=(3, 4), norm="ortho"
    )
    values = quantised.transpose(0, 3, 1, 4, 2).reshape(height, width, 3)
    result = codes.copy()
    result[:height, :width] = np.clip(np.round(values @ np.linalg.inv(matrix).T + 128), 0, 255)
    return result


class LightExamples:
    """Source of regions: a random picture, and some of its regions by the area of their discs.

    Args:
        folder: Set made by ``train.prepare_light``.

    Raises:
        DataFileError: The folder holds no set.
    """

    def __init__(self, folder: str) -> None:
        paths = sorted(Path(folder).glob("scene-*.npz"))
        if not paths:
            raise DataFileError(
                f"{folder}: expected scenes of train.prepare_light, found none; make them first"
            )
        tables = [np.load(path) for path in paths]
        tables = [table for table in tables if len(table["sizes"])]
        names = ("features", "stored", "true", "surround", "area")
        self.columns = {name: np.concatenate([table[name] for table in tables]) for name in names}
        sizes = np.concatenate([table["sizes"] for table in tables])
        kinds = [np.full(int(table["sizes"].sum()), bool(table["is_light"])) for table in tables]
        self.is_light = np.concatenate(kinds)
        self._first = np.concatenate([[0], np.cumsum(sizes)])
        radius = np.sqrt(self.columns["area"] / np.pi) + _SAMPLING_RADIUS_PX
        self._weight = radius.astype(np.float64) ** 2

    def draw(self, rng: np.random.Generator) -> dict[str, Tensor]:
        """Draw some regions of one picture, (_REGIONS, ...)."""
        picture = int(rng.integers(len(self._first) - 1))
        first, last = self._first[picture], self._first[picture + 1]
        sums = np.cumsum(self._weight[first:last])
        rows = first + np.searchsorted(sums, rng.random(_REGIONS) * sums[-1])
        return {name: torch.from_numpy(column[rows]) for name, column in self.columns.items()}


def held_out_regions(folder: str) -> tuple[dict[str, Tensor], np.ndarray]:
    """Return all regions of a set, and whether each is of a scene with light, (regions,)."""
    examples = LightExamples(folder)
    return {name: torch.from_numpy(column) for name, column in examples.columns.items()}, examples.is_light

"""Photographs as surface textures: those in the scikit-image wheel, or any folder of images."""

import functools
import importlib.util
from pathlib import Path

import numpy as np
import torch
from torch.nn.functional import interpolate

from bokehnet.errors import ImageFileError, MissingExtraError, ParameterError

__all__ = ["SHIPPED", "crop_photograph", "photograph_files"]

# Sample photographs in skimage/data of the wheel; no download.
SHIPPED = (
    "astronaut.png",
    "brick.png",
    "camera.png",
    "chelsea.png",
    "coffee.png",
    "coins.png",
    "color.png",
    "grass.png",
    "gravel.png",
    "hubble_deep_field.jpg",
    "ihc.png",
    "moon.png",
    "motorcycle_left.png",
    "motorcycle_right.png",
    "page.png",
    "retina.jpg",
    "rocket.jpg",
    "text.png",
)
_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".exr", ".hdr")


def photograph_files(names: tuple[str, ...] = (), folder: str | None = None) -> tuple[Path, ...]:
    """Return the paths of the photographs.

    Args:
        names: Names of :data:`SHIPPED` photographs without suffix; empty means all.
        folder: Folder whose images are used instead.

    Raises:
        ParameterError: A name is not that of a shipped photograph.
        ImageFileError: The folder holds no image.
        MissingExtraError: scikit-image is not installed.
    """
    if folder is not None:
        root = Path(folder)
        files = tuple(sorted(path for path in root.glob("*") if path.suffix.lower() in _SUFFIXES))
        if not files:
            raise ImageFileError(
                f"{folder}: expected a folder with images ({', '.join(_SUFFIXES)}), found none"
            )
        return files
    spec = importlib.util.find_spec("skimage")
    if spec is None or spec.origin is None:
        raise MissingExtraError("the sample photographs need scikit-image: pip install 'bokehnet[train]'")
    shipped = {name.split(".")[0]: Path(spec.origin).parent / "data" / name for name in SHIPPED}
    for name in names:
        if name not in shipped:
            expected = f"some of {', '.join(sorted(shipped))}"
            raise ParameterError("photographs", expected, name)
    return tuple(shipped[name] for name in names or shipped)


def crop_photograph(path: Path, height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Return a random crop of a photograph, resampled to (height, width, 3), with varied colours.

    The crop is rotated, mirrored, slightly recoloured and area-averaged, so it has no aliasing.
    """
    picture = _load(path)
    if rng.random() < 0.3:
        picture = np.rot90(picture, int(rng.integers(1, 4)))
    if rng.random() < 0.5:
        picture = picture[:, ::-1]
    # The largest crop of these proportions, or a smaller one that is not yet blurred.
    largest = min(picture.shape[0] / height, picture.shape[1] / width)
    scale = np.exp(rng.uniform(np.log(min(0.8, largest)), np.log(largest)))
    h, w = (
        max(1, min(int(size * scale), limit))
        for size, limit in zip((height, width), picture.shape, strict=False)
    )
    top, left = rng.integers(picture.shape[0] - h + 1), rng.integers(picture.shape[1] - w + 1)
    part = np.ascontiguousarray(picture[top : top + h, left : left + w].transpose(2, 0, 1))
    resized = interpolate(
        torch.from_numpy(part)[None], (height, width), mode="bilinear", antialias=True, align_corners=False
    )
    return _recolour(resized[0].numpy().transpose(1, 2, 0), rng)


def _recolour(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Vary contrast, saturation and white balance; values stay at least 0."""
    picture = np.clip(picture, 1e-4, None) ** rng.uniform(0.75, 1.3)
    if rng.random() < 0.15:
        picture = picture[..., rng.permutation(3)]
    grey = picture.mean(-1, keepdims=True)
    picture = np.clip(grey + (picture - grey) * rng.uniform(0.5, 1.6), 0, None)
    tint = np.exp(rng.normal(0, 0.45 if np.ptp(picture[::8, ::8], axis=-1).max() < 0.02 else 0.12, 3))
    return (picture * tint).astype(np.float32)


@functools.lru_cache(maxsize=64)
def _load(path: Path) -> np.ndarray:
    """Read a photograph, scene-linear (H, W, 3), at most about 1000 pixels wide."""
    from bokehnet.io.image import read_image

    picture = read_image(path)
    shrink = max(picture.shape) // 1000 + 1
    if shrink > 1:
        tensor = torch.from_numpy(np.ascontiguousarray(picture.transpose(2, 0, 1)))[None]
        size = (picture.shape[0] // shrink, picture.shape[1] // shrink)
        picture = interpolate(tensor, size, mode="area")[0].numpy().transpose(1, 2, 0)
    return np.ascontiguousarray(picture, np.float32)

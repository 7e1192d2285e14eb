"""Files of the benchmark: portable float maps (PFM) for linear light and depth, PNG for the rest."""

from pathlib import Path

import numpy as np
from PIL import Image

__all__ = [
    "BenchError",
    "decode_srgb",
    "encode_srgb",
    "read_picture",
    "write_grey16",
    "write_pfm",
    "write_png",
]


class BenchError(Exception):
    """Error of a user's file, command or method; the message is one line."""


def encode_srgb(linear: np.ndarray) -> np.ndarray:
    """Return scene-linear light clipped to [0, 1] and encoded as sRGB, float64 (IEC 61966-2-1)."""
    x = np.clip(np.asarray(linear, np.float64), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 0.0031308) ** (1 / 2.4) - 0.055)


def decode_srgb(encoded: np.ndarray) -> np.ndarray:
    """Return the linear light of sRGB values in [0, 1], float64."""
    x = np.asarray(encoded, np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((np.maximum(x, 0.04045) + 0.055) / 1.055) ** 2.4)


def write_pfm(path: Path, values: np.ndarray) -> None:
    """Write (H, W) or (H, W, 3) as little-endian float32; rows from bottom to top, as the format demands."""
    kind = "PF" if values.ndim == 3 else "Pf"
    header = f"{kind}\n{values.shape[1]} {values.shape[0]}\n-1.0\n"
    path.write_bytes(header.encode() + np.ascontiguousarray(values[::-1], "<f4").tobytes())


def _read_pfm(path: Path) -> np.ndarray:
    try:
        kind, size, scale, data = path.read_bytes().split(b"\n", 3)
        width, height = (int(word) for word in size.split())
        channels = {b"PF": 3, b"Pf": 1}[kind.strip()]
        values = np.frombuffer(data, "<f4" if float(scale) < 0 else ">f4", width * height * channels)
    except (ValueError, KeyError) as error:
        raise BenchError(f"{path}: expected a portable float map (PFM): {error}") from error
    shape = (height, width, 3) if channels == 3 else (height, width)
    return np.asarray(values.reshape(shape)[::-1], np.float32)


def write_png(path: Path, linear: np.ndarray) -> None:
    """Write scene-linear light as 8-bit sRGB."""
    Image.fromarray(np.round(255 * encode_srgb(linear)).astype(np.uint8)).save(path)


def write_grey16(path: Path, values: np.ndarray) -> None:
    """Write values from 0 to 1 as 16-bit grey PNG."""
    Image.fromarray(np.round(65535 * np.clip(values, 0, 1)).astype(np.uint16)).save(path)


def read_picture(path: Path) -> np.ndarray:
    """Read a picture as scene-linear (H, W, 3) float32, or a map as (H, W): PFM, NPY, or PNG in sRGB.

    Raises:
        BenchError: The file is missing, damaged or of another format.
    """
    try:
        if path.suffix == ".pfm":
            return _read_pfm(path)
        if path.suffix == ".npy":
            return np.asarray(np.load(path, allow_pickle=False), np.float32)
        with Image.open(path) as image:
            if image.mode.startswith("I;16"):
                return np.asarray(image, np.float32) / 65535
            return decode_srgb(np.asarray(image.convert("RGB")) / 255).astype(np.float32)
    except (OSError, ValueError) as error:
        raise BenchError(f"{path}: expected a readable PFM, NPY or PNG: {error}") from error

"""Probe pictures with blur in closed form, each of which reveals one fault of a method."""

import math
from collections.abc import Callable

import numpy as np

__all__ = ["FAULTS", "faults"]

# Name of a fault, and its measure in per cent; 0 is best.
FAULTS = {
    "leak": "light from behind focus on a sharp foreground, mean over the blur radius",
    "outline": "RMS error of the edge profile of a blurred foreground: occluded background is missing",
    "disc": "fraction of a small lamp's light outside its disc",
    "ringing": "sum of the brightness rises of its disc outwards, ring by ring, relative to the true level",
    "light": "light of the lamp that is lost (below 0) or gained",
    "colour": "change of its colour inside the disc, channel over sum, mean",
}

_RADIUS_PX = 12

Method = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _half_planes(right: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture, black and in focus on the left, white with defocus ``right`` on the right."""
    image = np.zeros((96, 128, 3), np.float32)
    image[:, 64:] = 1
    return image, np.where(image[..., 0] > 0, right, 0).astype(np.float32)


def edge_profile(distance: np.ndarray, radius: float) -> np.ndarray:
    """Return the fraction of a disc on the near side of an edge at signed distances from its centre."""
    t = np.clip(distance / radius, -1, 1)
    return 0.5 + (t * np.sqrt(1 - t * t) + np.arcsin(t)) / math.pi


def _leak(method: Method) -> float:
    image, defocus = _half_planes(-_RADIUS_PX)
    return 100 * float(method(image, defocus)[24:72, 64 - _RADIUS_PX : 64].mean())


def _outline(method: Method) -> float:
    image, defocus = _half_planes(_RADIUS_PX)
    columns = np.arange(64 - 2 * _RADIUS_PX, 64 + 2 * _RADIUS_PX)
    profile = method(image, defocus)[24:72, columns].mean(axis=(0, 2))
    expected = edge_profile(columns - 63.5, _RADIUS_PX)
    return 100 * float(np.sqrt(((profile - expected) ** 2).mean()))


def disc_of_lamp() -> np.ndarray:
    """Return the light of a lamp of 3x3 pixels at the centre of (97, 97), blurred by a disc, sum 1."""
    parts = 8
    position = (np.arange(97 * parts) + 0.5) / parts - 48.5
    disc = (np.hypot(position[None, :], position[:, None]) <= _RADIUS_PX).astype(float)
    disc = disc.reshape(97, parts, 97, parts).sum(axis=(1, 3))
    lamp = sum(np.roll(disc, (j, i), (0, 1)) for j in (-1, 0, 1) for i in (-1, 0, 1))
    return np.asarray(lamp / lamp.sum())


def ringing(disc: np.ndarray, level: float) -> float:
    """Return the sum of the rises of a disc's mean brightness from ring to ring outwards, over ``level``.

    Rings are a pixel wide around the centre of ``disc``, (97, 97), up to twice the blur radius.
    """
    y, x = np.mgrid[-48:49, -48:49]
    ring = np.rint(np.hypot(x, y)).astype(np.int64).ravel()
    profile = np.bincount(ring, disc.ravel()) / np.bincount(ring)
    return float(np.clip(np.diff(profile[: 2 * _RADIUS_PX + 1]), 0, None).sum() / level)


def _lamp(method: Method) -> dict[str, float]:
    image = np.zeros((97, 97, 3), np.float32)
    colour = np.array([30.0, 20.0, 10.0])
    image[47:50, 47:50] = colour
    rendered = method(image, np.full(image.shape[:2], -_RADIUS_PX, np.float32)).astype(np.float64)
    grey, expected = rendered.sum(axis=2), disc_of_lamp()
    inside = (expected > 0.5 * expected.max()) & (grey > 0)
    chromaticity = rendered[inside] / grey[inside][:, None]
    return {
        "disc": 50 * float(np.abs(grey / grey.sum() - expected).sum()),
        "ringing": 100 * ringing(grey / grey.sum(), float(expected.max())),
        "light": 100 * float(grey.sum() / (9 * colour.sum()) - 1),
        "colour": 100 * float(np.abs(chromaticity - colour / colour.sum()).mean()),
    }


def faults(method: Method) -> dict[str, float]:
    """Measure every fault of ``FAULTS``.

    Args:
        method: Function of image (H, W, 3), scene-linear, and defocus (H, W), pixels, + in front of focus.
    """
    return {"leak": _leak(method), "outline": _outline(method), **_lamp(method)}

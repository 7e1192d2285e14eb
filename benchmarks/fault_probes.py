"""Pictures whose blur is known in closed form, each of which brings out one fault of a method."""

import math
from collections.abc import Callable

import numpy as np

__all__ = ["FAULTS", "faults"]

# Name of a fault, and what is measured, in per cent; 0 is best.
FAULTS = {
    "leak": "light from behind focus on what stands sharp before it, mean over the blur's radius",
    "outline": "RMS error of the profile of a blurred foreground's edge: what it hides is missing",
    "disc": "light of a small lamp that does not fall where its disc lies, of all that arrives",
    "ringing": "by how much its disc grows brighter again outwards, ring by ring, of its right level",
    "light": "light of that lamp that is lost (below 0) or gained",
    "colour": "change of its colour inside the disc, channel over sum, mean",
}

_RADIUS = 12

Method = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _half_planes(right: float) -> tuple[np.ndarray, np.ndarray]:
    """Black and in focus on the left, white and of the given defocus on the right."""
    image = np.zeros((96, 128, 3), np.float32)
    image[:, 64:] = 1
    return image, np.where(image[..., 0] > 0, right, 0).astype(np.float32)


def edge_profile(distance: np.ndarray, radius: float) -> np.ndarray:
    """Share of a disc that lies on the near side of a straight edge at signed distances from its middle."""
    t = np.clip(distance / radius, -1, 1)
    return 0.5 + (t * np.sqrt(1 - t * t) + np.arcsin(t)) / math.pi


def _leak(method: Method) -> float:
    image, defocus = _half_planes(-_RADIUS)
    return 100 * float(method(image, defocus)[24:72, 64 - _RADIUS : 64].mean())


def _outline(method: Method) -> float:
    image, defocus = _half_planes(_RADIUS)
    columns = np.arange(64 - 2 * _RADIUS, 64 + 2 * _RADIUS)
    found = method(image, defocus)[24:72, columns].mean(axis=(0, 2))
    wanted = edge_profile(columns - 63.5, _RADIUS)
    return 100 * float(np.sqrt(((found - wanted) ** 2).mean()))


def disc_of_lamp() -> np.ndarray:
    """Light of a lamp of 3x3 pixels in the middle of (97, 97), blurred by a disc; sum 1."""
    parts = 8
    at = (np.arange(97 * parts) + 0.5) / parts - 48.5
    disc = (np.hypot(at[None, :], at[:, None]) <= _RADIUS).astype(float)
    disc = disc.reshape(97, parts, 97, parts).sum(axis=(1, 3))
    lamp = sum(np.roll(disc, (j, i), (0, 1)) for j in (-1, 0, 1) for i in (-1, 0, 1))
    return np.asarray(lamp / lamp.sum())


def ringing(disc: np.ndarray, level: float) -> float:
    """Sum of all rises of a disc's mean brightness from ring to ring outwards, of ``level``.

    Rings are a pixel wide around the middle of ``disc``, (97, 97), up to twice the blur's radius.
    """
    y, x = np.mgrid[-48:49, -48:49]
    ring = np.rint(np.hypot(x, y)).astype(np.int64).ravel()
    profile = np.bincount(ring, disc.ravel()) / np.bincount(ring)
    return float(np.clip(np.diff(profile[: 2 * _RADIUS + 1]), 0, None).sum() / level)


def _lamp(method: Method) -> dict[str, float]:
    image = np.zeros((97, 97, 3), np.float32)
    colour = np.array([30.0, 20.0, 10.0])
    image[47:50, 47:50] = colour
    found = method(image, np.full(image.shape[:2], -_RADIUS, np.float32)).astype(np.float64)
    grey, wanted = found.sum(axis=2), disc_of_lamp()
    inside = (wanted > 0.5 * wanted.max()) & (grey > 0)
    shares = found[inside] / grey[inside][:, None]
    return {
        "disc": 50 * float(np.abs(grey / grey.sum() - wanted).sum()),
        "ringing": 100 * ringing(grey / grey.sum(), float(wanted.max())),
        "light": 100 * float(grey.sum() / (9 * colour.sum()) - 1),
        "colour": 100 * float(np.abs(shares - colour / colour.sum()).mean()),
    }


def faults(method: Method) -> dict[str, float]:
    """Measure every fault of ``FAULTS``.

    Args:
        method: (image (H, W, 3) scene-linear, defocus (H, W) in pixels, + in front of focus) -> picture.
    """
    return {"leak": _leak(method), "outline": _outline(method), **_lamp(method)}

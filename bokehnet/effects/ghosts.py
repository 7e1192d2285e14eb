"""Ghosts of lamps, drawn into a picture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.arrays.pyramid import upsample2
from bokehnet.effects.lamps import Lamps
from bokehnet.lenses.ghosts import Ghost, trace_ghosts
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.optics.spectral.coating import Coating

__all__ = ["Ghosts", "draw_ghost"]

# Wavelengths of red, green and blue, nm.
_WAVELENGTHS_NM = (610.0, 550.0, 465.0)
# Rays along each side of the bundle, and points along each side of a cell between them.
_BUNDLE_SIDE, _CELL_POINTS = 32, 6
# Distance within which lamps are merged, as a fraction of the picture's half-diagonal; maximum number of
# lamps; minimum light relative to the brightest one.
_MERGE_DISTANCE, _MAX_LAMPS, _MIN_LIGHT_RATIO = 0.02, 8, 0.02
_LEVELS = 6
_VIGNETTED_FILL = 1e5


@dataclass(frozen=True, kw_only=True, slots=True)
class Ghosts:
    """Reflections inside a lens.

    Attributes:
        lens: Lens at its focus and f-number.
        half_diagonal: Half-diagonal of the picture, mm on the sensor.
        coating: Coating of its surfaces.
    """

    lens: PrescriptionLens
    half_diagonal: float
    coating: Coating = "single"

    def light(self, lamps: Lamps, height: int, width: int) -> np.ndarray:
        """Return the light of all ghosts, (height, width, 3), of lamps that are assumed to be far away."""
        half_diagonal = 0.5 * float(np.hypot(height, width))
        scale = half_diagonal / self.half_diagonal  # pixels per mm
        middle = np.array([width - 1, height - 1]) / 2
        levels = [
            np.zeros((3, -(-height // 2**level), -(-width // 2**level)), np.float32)
            for level in range(_LEVELS)
        ]
        for position, light in _sources(lamps, _MERGE_DISTANCE * half_diagonal):
            x, y = (position - middle) / scale
            for channel, wavelength in enumerate(_WAVELENGTHS_NM):
                for ghost in trace_ghosts(
                    self.lens, (x, y), wavelength=wavelength, coating=self.coating, side=_BUNDLE_SIDE
                ):
                    draw_ghost([plane[channel] for plane in levels], ghost, middle, scale, light[channel])
        drawn = levels[-1]
        for plane in levels[-2::-1]:
            drawn = plane + upsample2(drawn)[:, : plane.shape[1], : plane.shape[2]]
        return np.moveaxis(drawn, 0, -1)


def _sources(lamps: Lamps, distance: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return positions x, y and light of merged adjacent lamps, the brightest first."""
    cell = np.stack([lamps.row // distance, lamps.column // distance], -1)
    _, group = np.unique(cell, axis=0, return_inverse=True)
    group = group.ravel()
    count = int(group.max(initial=-1)) + 1
    light = np.stack([np.bincount(group, lamps.light[:, c], count) for c in range(3)], -1)
    weight = lamps.light.sum(-1)
    total = np.bincount(group, weight, count)
    position = (
        np.stack(
            [np.bincount(group, weight * coordinate, count) for coordinate in (lamps.column, lamps.row)], -1
        )
        / total[:, None]
    )
    order = [i for i in np.argsort(-total)[:_MAX_LAMPS] if total[i] >= _MIN_LIGHT_RATIO * total.max()]
    return [(position[i], light[i]) for i in order]


def draw_ghost(
    levels: Sequence[np.ndarray], ghost: Ghost, middle: np.ndarray, scale: float, light: float
) -> None:
    """Add a ghost to a picture in levels of half the size each: to the finest one without gaps.

    Args:
        levels: Light per pixel of the finest level; written.
        ghost: Ghost to draw.
        middle: Centre of the picture, x and y in pixels of the finest level.
        scale: Pixels of the finest level per mm.
        light: Light of the lamp.
    """
    position = middle + ghost.place * scale
    corners = np.stack([ghost.fill[:-1, :-1], ghost.fill[:-1, 1:], ghost.fill[1:, :-1], ghost.fill[1:, 1:]])
    cells = (corners.max(0) < _VIGNETTED_FILL) & (corners.min(0) <= 1)
    if not cells.any():
        return
    fraction = (np.arange(_CELL_POINTS) + 0.5) / _CELL_POINTS
    b, a = (part.ravel() for part in np.meshgrid(fraction, fraction))
    weights = np.stack([(1 - a) * (1 - b), (1 - a) * b, a * (1 - b), a * b])

    def interpolate(values: np.ndarray) -> np.ndarray:
        """Return the values at the points of each cell, (cells, points^2, ...)."""
        four = (values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:])
        return np.einsum("kc...,kp->cp...", np.stack([one[cells] for one in four]), weights)

    passes = interpolate(ghost.fill) <= 1
    if not passes.any():
        return
    points = interpolate(position)
    step = np.hypot(*np.moveaxis(points[:, 1] - points[:, 0], -1, 0))
    down = np.hypot(*np.moveaxis(points[:, _CELL_POINTS] - points[:, 0], -1, 0))
    widest = np.maximum(step, down)[passes.any(1)].max()
    level = int(np.clip(np.ceil(np.log2(max(widest, 1e-9))), 0, len(levels) - 1))
    plane, size = levels[level], 2.0**level
    flux = interpolate(ghost.flux)[passes] * (light / _CELL_POINTS**2 / size**2)
    x, y = ((points[passes] + 0.5) / size - 0.5).T
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    inside_plane = (left >= -1) & (left < plane.shape[1]) & (top >= -1) & (top < plane.shape[0])
    if not inside_plane.any():
        return
    left, top, flux = left[inside_plane], top[inside_plane], flux[inside_plane]
    x, y = x[inside_plane] - left, y[inside_plane] - top
    # The ghost is drawn in a window, which may exceed the picture.
    first = int(top.min()), int(left.min())
    shape = int(top.max()) - first[0] + 2, int(left.max()) - first[1] + 2
    index = (top - first[0]) * shape[1] + left - first[1]
    drawn = np.zeros(shape[0] * shape[1])
    for step, weight in (
        (0, (1 - y) * (1 - x)),
        (1, (1 - y) * x),
        (shape[1], y * (1 - x)),
        (shape[1] + 1, y * x),
    ):
        drawn += np.bincount(index + step, flux * weight, drawn.size)
    inside = [
        slice(max(0, -start), min(size, limit - start))
        for start, size, limit in zip(first, shape, plane.shape, strict=True)
    ]
    rows, columns = (
        slice(start + window.start, start + window.stop) for start, window in zip(first, inside, strict=True)
    )
    plane[rows, columns] += drawn.reshape(shape)[inside[0], inside[1]]

"""Least-squares problem of a look: pixels around the discs of a photograph, residuals and derivatives."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.fit.disc_model import LOOK, Look, draw_disc
from bokehnet.lenses.fit.discs import Disc
from bokehnet.lenses.fit.least_squares import Solution, solve
from bokehnet.optics.aberrations.chromatic_aberration import glass_curve
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

__all__ = ["CLIPPED", "DiscProblem", "Window", "box_of", "window_of"]

# Light from which on a photograph counts as clipped.
CLIPPED = 0.985
# Half-width of a window, in disc radii.
_WINDOW_RADII = 1.35
# Upper bound of the residual of a disc over the median residual; worse discs are rejected.
_MAX_RELATIVE_RESIDUAL = 2.5


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Pixels around one disc: columns and rows (N,), light (N, C), and the scale of its light (C,)."""

    x: np.ndarray
    y: np.ndarray
    light: np.ndarray
    scale: np.ndarray


class DiscProblem:
    """Residuals of discs as a function of a vector of look parameters and positions."""

    def __init__(
        self, names: Sequence[str], start: Look, windows: Sequence[Window], size: tuple[int, int], side: int
    ) -> None:
        self.names, self.start, self.windows = list(names), start, windows
        self.size, self.side = size, side
        self.half = 0.5 * math.hypot(*size)
        channels = windows[0].light.shape[1]
        sampled, _ = WavelengthSampling(dispersion="rgb").at((np.arange(3) + 0.5) / 3)
        self.curve = glass_curve("N-BK7")(sampled) if channels == 3 else np.zeros(1)

    def look(self, values: np.ndarray) -> Look:
        """Return the look of a vector of values."""
        parameters = dict(zip(self.names, values[: len(self.names)].tolist(), strict=True))
        return dataclasses.replace(self.start, **parameters)

    def shapes(self, look: Look, place: np.ndarray, x: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
        """Return the disc at pixels, for each channel."""
        discs = []
        for strength in self.curve:
            offset = place[:2] - (np.array(self.size) - 1) / 2
            middle = place[:2] + look.lateral / 100 * strength * offset
            radius = self.side * place[2] - look.axial / 100 * strength * self.half
            discs.append(draw_disc(look, x, y, (middle[0], middle[1]), radius, self.size))
        return discs

    def disc_residuals(self, look: Look, place: np.ndarray, window: Window) -> np.ndarray:
        """Return the residuals of one disc after fitting its shape and a plane, relative to its light."""
        x, y = window.x, window.y
        plane = np.stack([np.ones_like(x), (x - x.mean()) / 20, (y - y.mean()) / 20], -1)
        parts = []
        for channel, shape in enumerate(self.shapes(look, place, x, y)):
            basis = np.concatenate([shape[:, None], plane], -1)
            light = window.light[:, channel]
            factors = np.linalg.solve(basis.T @ basis + 1e-9 * np.eye(4), basis.T @ light)
            parts.append((basis @ factors - light) / window.scale[channel])
        return np.concatenate(parts)

    def places(self, values: np.ndarray) -> np.ndarray:
        """Return centres and radii of a vector of values, (discs, 3), pixels."""
        return values[len(self.names) :].reshape(-1, 3)

    def residuals(self, values: np.ndarray) -> np.ndarray:
        """Return the residuals of all discs, concatenated, (N,)."""
        look, places = self.look(values), self.places(values)
        return np.concatenate(
            [self.disc_residuals(look, p, w) for p, w in zip(places, self.windows, strict=True)]
        )

    def jacobian(self, values: np.ndarray, base: np.ndarray) -> np.ndarray:
        """Return the derivatives of the residuals ``base`` with respect to the values, (N, P).

        Positions affect their own disc only.
        """
        jacobian = np.zeros((len(base), len(values)))
        for column, name in enumerate(self.names):
            _, high, step = LOOK[name]
            step = step if values[column] + step <= high else -step
            shifted = values.copy()
            shifted[column] += step
            jacobian[:, column] = (self.residuals(shifted) - base) / step
        look, places, first = self.look(values), self.places(values), 0
        for number, window in enumerate(self.windows):
            rows = slice(first, first + window.light.size)
            for axis in range(3):
                place = places[number].copy()
                place[axis] += 0.02
                column = len(self.names) + 3 * number + axis
                jacobian[rows, column] = (self.disc_residuals(look, place, window) - base[rows]) / 0.02
            first = rows.stop
        return jacobian

    def well_fitted(self, values: np.ndarray) -> np.ndarray:
        """Return True for discs whose residual is not an outlier, (discs,)."""
        look, pairs = self.look(values), zip(self.places(values), self.windows, strict=True)
        rms = np.array(
            [np.sqrt(np.mean(self.disc_residuals(look, place, window) ** 2)) for place, window in pairs]
        )
        return np.asarray(rms <= _MAX_RELATIVE_RESIDUAL * np.median(rms))

    def solve(self, places: np.ndarray, steps: int) -> Solution:
        """Fit look and positions, (discs, 3), in at most ``steps`` iterations."""
        look = [getattr(self.start, name) for name in self.names]
        bounds = np.array([LOOK[name][:2] for name in self.names]).reshape(-1, 2)
        reach = np.tile([0.4, 0.4, 0.4], len(places)) * np.repeat(places[:, 2], 3)
        flat = places.ravel()
        return solve(
            self.residuals,
            self.jacobian,
            np.concatenate([look, flat]),
            np.concatenate([bounds[:, 0], flat - reach]),
            np.concatenate([bounds[:, 1], flat + reach]),
            steps,
        )


def window_of(image: np.ndarray, disc: Disc, discs: Sequence[Disc], max_pixels: int) -> Window:
    """Return unclipped pixels around a disc that do not belong to others, at most ``max_pixels``."""
    rows, columns = box_of(image, disc)
    y, x = (axis.astype(float) for axis in np.mgrid[rows, columns])
    light = image[rows, columns]
    good = light.max(-1) < CLIPPED
    for other in discs:
        if other is not disc:
            good &= np.hypot(x - other.x, y - other.y) > 1.15 * other.radius + 2
    if good.sum() < 50:
        raise LensError(
            f"lights: expected light below white around x {disc.x:.0f}, y {disc.y:.0f}, found it clipped: "
            f"take a darker exposure or leave this lamp out"
        )
    indices = np.flatnonzero(good)
    # A uniform random subset, without preferred direction.
    indices = np.sort(np.random.default_rng(0).permutation(indices)[:max_pixels])
    light = light.reshape(-1, light.shape[-1])[indices].astype(float)
    scale = np.maximum(np.quantile(light, 0.9, axis=0) - np.quantile(light, 0.05, axis=0), 1e-6)
    return Window(x.ravel()[indices], y.ravel()[indices], light, np.maximum(scale, 0.2 * scale.max()))


def box_of(image: np.ndarray, disc: Disc) -> tuple[slice, slice]:
    """Return rows and columns of the window around a disc."""
    reach = _WINDOW_RADII * disc.radius + 3
    rows = slice(max(0, int(disc.y - reach)), min(image.shape[0], int(disc.y + reach) + 2))
    return rows, slice(max(0, int(disc.x - reach)), min(image.shape[1], int(disc.x + reach) + 2))

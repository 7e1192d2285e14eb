"""Pixels around the discs of a photograph, and what a look leaves of them."""

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

# Light from which a photograph is clipped.
CLIPPED = 0.985
# Windows reach so many radii from the middle of a disc.
_REACH = 1.35
# Discs of which so many times as much is left as of the middle one are given up.
_STRAY = 2.5


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Pixels around one disc: columns and rows (N,), light (N, C), and the scale of the disc's light."""

    x: np.ndarray
    y: np.ndarray
    light: np.ndarray
    scale: np.ndarray


class DiscProblem:
    """Residuals of discs for a vector of look and places."""

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
        """The look that is in a vector of values."""
        found = dict(zip(self.names, values[: len(self.names)].tolist(), strict=True))
        return dataclasses.replace(self.start, **found)

    def shapes(self, look: Look, place: np.ndarray, x: np.ndarray, y: np.ndarray) -> list[np.ndarray]:
        """The disc at pixels, for each channel."""
        drawn = []
        for strength in self.curve:
            away = place[:2] - (np.array(self.size) - 1) / 2
            middle = place[:2] + look.lateral / 100 * strength * away
            radius = self.side * place[2] - look.axial / 100 * strength * self.half
            drawn.append(draw_disc(look, x, y, (middle[0], middle[1]), radius, self.size))
        return drawn

    def one(self, look: Look, place: np.ndarray, window: Window) -> np.ndarray:
        """Residuals of one disc: what its shape and a plane do not explain, of its light."""
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
        """Middles and radii that are in a vector of values, (discs, 3), pixels."""
        return values[len(self.names) :].reshape(-1, 3)

    def residuals(self, values: np.ndarray) -> np.ndarray:
        """Residuals of all discs, one after the other, (N,)."""
        look, places = self.look(values), self.places(values)
        return np.concatenate([self.one(look, p, w) for p, w in zip(places, self.windows, strict=True)])

    def jacobian(self, values: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Derivatives of the residuals ``left`` by the values, (N, P); places touch their own disc alone."""
        found = np.zeros((len(left), len(values)))
        for column, name in enumerate(self.names):
            _, high, step = LOOK[name]
            step = step if values[column] + step <= high else -step
            moved = values.copy()
            moved[column] += step
            found[:, column] = (self.residuals(moved) - left) / step
        look, places, first = self.look(values), self.places(values), 0
        for number, window in enumerate(self.windows):
            rows = slice(first, first + window.light.size)
            for axis in range(3):
                place = places[number].copy()
                place[axis] += 0.02
                column = len(self.names) + 3 * number + axis
                found[rows, column] = (self.one(look, place, window) - left[rows]) / 0.02
            first = rows.stop
        return found

    def well_fitted(self, values: np.ndarray) -> np.ndarray:
        """Which discs are left no more than others, (discs,)."""
        look, pairs = self.look(values), zip(self.places(values), self.windows, strict=True)
        left = np.array([np.sqrt(np.mean(self.one(look, place, window) ** 2)) for place, window in pairs])
        return np.asarray(left <= _STRAY * np.median(left))

    def solve(self, places: np.ndarray, steps: int) -> Solution:
        """Fit look and places, (discs, 3), in so many steps at most."""
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


def window_of(image: np.ndarray, disc: Disc, discs: Sequence[Disc], most: int) -> Window:
    """Pixels around a disc that are not clipped and not of others."""
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
    chosen = np.flatnonzero(good)
    # Evenly, in an order that no direction has.
    chosen = np.sort(np.random.default_rng(0).permutation(chosen)[:most])
    light = light.reshape(-1, light.shape[-1])[chosen].astype(float)
    scale = np.maximum(np.quantile(light, 0.9, axis=0) - np.quantile(light, 0.05, axis=0), 1e-6)
    return Window(x.ravel()[chosen], y.ravel()[chosen], light, np.maximum(scale, 0.2 * scale.max()))


def box_of(image: np.ndarray, disc: Disc) -> tuple[slice, slice]:
    """Rows and columns around a disc, as far as windows reach."""
    reach = _REACH * disc.radius + 3
    rows = slice(max(0, int(disc.y - reach)), min(image.shape[0], int(disc.y + reach) + 2))
    return rows, slice(max(0, int(disc.x - reach)), min(image.shape[1], int(disc.x + reach) + 2))

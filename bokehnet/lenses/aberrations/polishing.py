"""Traces of grinding and polishing on a lens surface, and the rings that they draw in its blur.

The tool leaves concentric grooves whose radii vary, and the polish leaves fine noise. The heights are a
texture; their slopes, the normal map, turn a ray by ``(n - 1)`` times the slope, so that it misses its place
on the sensor by that angle times the distance to the sensor: blurred lights show rings as of an onion, and
grain.

Faults: one surface, at the pupil, behind a perfect lens; no diffraction, which softens rings closer than the
    square root of wavelength times distance.

Source: Joo, Kwon, Lee, Eisemann and Lee, "Efficient ray tracing through aspheric lenses and imperfect bokeh
synthesis", Computer Graphics Forum 2016, after Marsicano, "Rendering real time depth of field effects", 2023,
3.4.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_above, check_at_least, check_whole

__all__ = ["PolishedSurface", "polished_psf"]

# Cells along a radius of the normal map, and rays along each side of the pupil.
_CELLS, _RAYS = 512, 1536


@dataclass(frozen=True, kw_only=True)
class PolishedSurface:
    """Surface with traces of its making.

    Attributes:
        radius: Radius of the used area, mm.
        rings: Number of grooves along the radius.
        ring_height: Amplitude of the grooves, nm.
        wander: Standard deviation of a groove's radius, in distances of grooves.
        noise_height: Standard deviation of the polish's noise, nm.
        seed: Seed of both.

    Raises:
        ParameterError: A number is negative, or the radius or number of rings is not above 0.
    """

    radius: float = 12.0
    rings: int = 12
    ring_height: float = 30.0
    wander: float = 0.15
    noise_height: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_above("radius", self.radius, 0)
        check_whole("rings", self.rings, 1)
        for name in ("ring_height", "wander", "noise_height"):
            check_at_least(name, getattr(self, name), 0)

    def heights(self) -> np.ndarray:
        """Return the height map, nm, (N, N), over the square around the used area."""
        rng = np.random.default_rng(self.seed)
        side = 2 * _CELLS
        y, x = (np.mgrid[:side, :side] + 0.5 - _CELLS) / _CELLS
        groove = np.hypot(x, y) * self.rings
        # Each groove has a phase of its own, interpolated between the grooves.
        phases = self.wander * rng.normal(size=2 * self.rings + 2)
        groove = groove + np.interp(groove, np.arange(len(phases)), phases)
        noise = rng.normal(size=(side, side))
        for axis in (0, 1):  # a tool spans some cells
            noise = (np.roll(noise, 1, axis) + 2 * noise + np.roll(noise, -1, axis)) / 4
        noise *= self.noise_height / max(float(noise.std()), 1e-12)
        return self.ring_height * np.cos(2 * np.pi * groove) + noise

    def slopes(self) -> np.ndarray:
        """Return the normal map: slopes of the surface along x and y, (N, N, 2)."""
        down, across = np.gradient(self.heights() * 1e-6, self.radius / _CELLS)
        return np.stack([across, down], -1)


def polished_psf(
    surface: PolishedSurface, blur_radius: float, pixel_pitch: float, distance: float, index: float = 1.5
) -> np.ndarray:
    """Return the image of a blurred point, (S, S), sum 1.

    Args:
        surface: Surface at the pupil.
        blur_radius: Signed radius of the disc of the perfect lens, pixels.
        pixel_pitch: Pixel pitch, mm.
        distance: Distance from the pupil to the sensor, mm.
        index: Refractive index of the glass.

    Raises:
        ParameterError: A pitch or distance is not above 0.
    """
    check_above("pixel_pitch", pixel_pitch, 0)
    check_above("distance", distance, 0)
    half = int(np.ceil(abs(blur_radius))) + 3
    position = (np.arange(_RAYS) + 0.5) / _RAYS * 2 - 1
    x, y = (part.ravel() for part in np.meshgrid(position, position))
    inside = np.hypot(x, y) <= 1
    x, y = x[inside], y[inside]
    shift = surface.slopes()[_cell(y), _cell(x)] * ((index - 1) * distance / pixel_pitch)
    end = np.stack([blur_radius * x + shift[:, 0], blur_radius * y + shift[:, 1]], -1)
    edges = np.arange(2 * half + 2) - half - 0.5
    counts, _, _ = np.histogram2d(end[:, 1], end[:, 0], (edges, edges))
    return np.asarray(counts / len(x))


def _cell(position: np.ndarray) -> np.ndarray:
    return np.clip(((position + 1) * _CELLS).astype(int), 0, 2 * _CELLS - 1)

"""Random object outlines: alpha masks (H, W) in [0, 1], float32, with edges one texel wide.

Every mask is computed from signed distances in texels (negative inside), which gives antialiased edges. All
functions take the size of the mask and a NumPy generator.
"""

from collections.abc import Callable

import numpy as np

__all__ = ["OPEN_SHAPES", "SOLID_SHAPES", "THIN_SHAPES", "Canvas", "draw_shape"]

Shape = Callable[[int, int, np.random.Generator], np.ndarray]


class Canvas:
    """Mask as a union of simple shapes; positions are (x, y) in texels."""

    def __init__(self, height: int, width: int) -> None:
        self.alpha = np.zeros((height, width), np.float32)

    def add_stroke(self, start: np.ndarray, end: np.ndarray, radius: float, end_radius: float) -> None:
        """Add a straight stroke with round ends whose radius changes along it."""
        low = np.minimum(start, end) - max(radius, end_radius) - 1
        high = np.maximum(start, end) + max(radius, end_radius) + 2
        window, x, y = self._window(low, high)
        dx, dy = end - start
        length_squared = max(dx * dx + dy * dy, 1e-12)
        along = np.clip(((x - start[0]) * dx + (y - start[1]) * dy) / length_squared, 0, 1)
        distance = np.hypot(x - start[0] - along * dx, y - start[1] - along * dy)
        self._add(window, distance - (radius + along * (end_radius - radius)))

    def add_path(self, points: np.ndarray, radii: np.ndarray) -> None:
        """Add a chain of strokes through ``points`` (N, 2)."""
        for i in range(len(points) - 1):
            self.add_stroke(points[i], points[i + 1], float(radii[i]), float(radii[i + 1]))

    def add_leaf(self, centre: np.ndarray, angle: float, length: float, breadth: float) -> None:
        """Add a pointed leaf between two arcs; ``length`` and ``breadth`` are half extents."""
        window, x, y = self._window(centre - length - 1, centre + length + 2)
        cosine, sine = np.cos(angle), np.sin(angle)
        along = cosine * (x - centre[0]) + sine * (y - centre[1])
        across = cosine * (y - centre[1]) - sine * (x - centre[0])
        bend = (length**2 - breadth**2) / (2 * breadth)
        self._add(window, np.hypot(along, np.abs(across) + bend) - (bend + breadth))

    def _window(
        self, low: np.ndarray, high: np.ndarray
    ) -> tuple[tuple[slice, slice], np.ndarray, np.ndarray]:
        height, width = self.alpha.shape
        left, right = (int(np.clip(np.floor(bound[0]), 0, width)) for bound in (low, high))
        top, bottom = (int(np.clip(np.floor(bound[1]), 0, height)) for bound in (low, high))
        x, y = np.arange(left, right) + 0.5, np.arange(top, bottom)[:, None] + 0.5
        return (slice(top, bottom), slice(left, right)), x, y

    def _add(self, window: tuple[slice, slice], distance: np.ndarray) -> None:
        self.alpha[window] = np.maximum(self.alpha[window], _coverage(distance))


def draw_shape(kinds: dict[str, Shape], height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Draw a random shape out of ``kinds``."""
    return kinds[list(kinds)[rng.integers(len(kinds))]](height, width, rng)


def _coverage(distance: np.ndarray) -> np.ndarray:
    """Return the coverage of a texel by a shape whose edge is ``distance`` texels away."""
    return np.clip(0.5 - distance, 0, 1)


def _axes(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the texel centres relative to the middle, x (1, W) and y (H, 1)."""
    return np.arange(width)[None] + 0.5 - width / 2, np.arange(height)[:, None] + 0.5 - height / 2


def _card(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Draw a rectangle with round corners of random radius."""
    x, y = _axes(height, width)
    radius = rng.uniform(0, 0.3) * min(height, width)
    dx, dy = np.abs(x) - (width / 2 - 1.5 - radius), np.abs(y) - (height / 2 - 1.5 - radius)
    outside = np.hypot(np.maximum(dx, 0), np.maximum(dy, 0))
    return _coverage(outside + np.minimum(np.maximum(dx, dy), 0) - radius).astype(np.float32)


def _blob(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Draw a smooth closed curve: an ellipse perturbed by a few waves."""
    x, y = _axes(height, width)
    angle = np.arctan2(y / height, x / width)
    waves = np.arange(2, 9)
    size = rng.uniform(0, 0.5) / waves**1.2
    phase = rng.uniform(0, 2 * np.pi, len(waves))
    ripple = (size * np.cos(waves * angle[..., None] + phase)).sum(-1)
    outline = (1 + ripple) / (1 + np.abs(size).sum())
    distance = np.hypot(x / max(width / 2 - 1.5, 0.5), y / max(height / 2 - 1.5, 0.5)) - outline
    steep = np.hypot(*np.gradient(distance)) if min(height, width) > 1 else np.ones_like(distance)
    return _coverage(distance / np.maximum(steep, 1e-6)).astype(np.float32)


def _polygon(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Draw a convex polygon with three to eight edges."""
    x, y = _axes(height, width)
    count = rng.integers(3, 9)
    angles = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * 2 * np.pi / count + rng.uniform(0, 7)
    reach = min(height, width) / 2 - 1.5
    sides = [x * np.cos(a) + y * np.sin(a) - reach * rng.uniform(0.5, 0.95) for a in angles]
    frame = np.maximum(np.abs(x) - width / 2 + 1.5, np.abs(y) - height / 2 + 1.5)
    return _coverage(np.maximum(np.max(sides, 0), frame)).astype(np.float32)


def _sprout(
    canvas: Canvas, rng: np.random.Generator, start: np.ndarray, angle: float, radius: float, depth: int
) -> None:
    """Draw a bent branch and, to the recursion ``depth``, its twigs."""
    size = max(canvas.alpha.shape)
    steps, length = 7, size * rng.uniform(0.3, 0.6) * 0.65 ** (2 - depth)
    angles = angle + np.cumsum(rng.normal(0, 0.22, steps))
    points = start + np.concatenate([np.zeros((1, 2)), np.cumsum(_unit(angles) * length / steps, 0)])
    canvas.add_path(points, np.linspace(radius, 0.6 * radius, steps + 1))
    for i in range(2, steps + 1):
        if depth > 0 and rng.random() < 0.6:
            turn = rng.choice([-1, 1]) * rng.uniform(0.4, 1.1)
            _sprout(canvas, rng, points[i], angles[i - 1] + turn, 0.65 * radius, depth - 1)


def _unit(angles: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angles), np.sin(angles)], -1)


def _branch(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Draw bare branches that grow from the lower edge."""
    canvas = Canvas(height, width)
    for _ in range(rng.integers(1, 4)):
        start = np.array([rng.uniform(0.2, 0.8) * width, height - 1.0])
        _sprout(
            canvas, rng, start, rng.normal(-np.pi / 2, 0.3), max(height, width) * rng.uniform(0.008, 0.03), 2
        )
    return canvas.alpha


def _foliage(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Draw leaves in loose clusters with gaps."""
    canvas = Canvas(height, width)
    size = min(height, width)
    length = size * rng.uniform(0.04, 0.16)
    clusters = rng.uniform(0.15, 0.85, (rng.integers(1, 5), 2))
    main = rng.uniform(0, np.pi)
    for _ in range(int(rng.uniform(0.3, 1.2) * size**2 / length**2 / 2)):
        place = clusters[rng.integers(len(clusters))] + rng.normal(0, 0.16, 2)
        centre = place * [width, height]
        if (np.abs(centre - [width / 2, height / 2]) < np.array([width, height]) / 2 - length).all():
            scale = length * rng.uniform(0.6, 1.0)
            canvas.add_leaf(centre, rng.normal(main, 0.7), scale, scale * rng.uniform(0.25, 0.55))
    return canvas.alpha


def _blades(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Draw grass or hair: curved, tapered strokes from the lower edge."""
    canvas = Canvas(height, width)
    thin = rng.random() < 0.5
    steps = 8
    for _ in range(rng.integers(20, 90) if thin else rng.integers(8, 40)):
        radius = rng.uniform(0.35, 0.8) if thin else max(height, width) * rng.uniform(0.005, 0.02)
        bend = np.cumsum(rng.normal(rng.normal(0, 0.12), 0.04, steps))
        angles = rng.normal(-np.pi / 2, 0.25) + bend
        step = height * rng.uniform(0.4, 0.95) / steps
        start = np.array([rng.uniform(0.05, 0.95) * width, float(height)])
        points = start + np.concatenate([np.zeros((1, 2)), np.cumsum(_unit(angles) * step, 0)])
        canvas.add_path(points, np.linspace(radius, 0.4 * radius, steps + 1))
    return canvas.alpha


def _fence(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Draw wires or bars in one or two directions."""
    x, y = _axes(height, width)
    spacing = max(height, width) * rng.uniform(0.08, 0.3)
    radius = max(0.5, spacing * rng.uniform(0.03, 0.2))
    angle = rng.choice([0.0, np.pi / 4, rng.uniform(0, np.pi)])
    alpha = np.zeros((height, width), np.float32)
    for turn in (0, np.pi / 2)[: rng.integers(1, 3)]:
        across = (x * np.cos(angle + turn) + y * np.sin(angle + turn)) / spacing
        distance = np.abs(across - np.round(across)) * spacing - radius
        alpha = np.maximum(alpha, _coverage(distance).astype(np.float32))
    return alpha


def _ring(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Draw a disc with a round hole."""
    x, y = _axes(height, width)
    reach = min(height, width) / 2 - 1.5
    outer, hole = reach, reach * rng.uniform(0.3, 0.9)
    distance = np.hypot(x, y)
    return _coverage(np.maximum(distance - outer, hole - distance)).astype(np.float32)


def _scribble(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Draw a few thick strokes like a letter."""
    canvas = Canvas(height, width)
    radius = min(height, width) * rng.uniform(0.03, 0.09)
    margin = radius + 1.5
    for _ in range(rng.integers(2, 5)):
        points = rng.uniform(margin, np.maximum([width - margin, height - margin], margin), (3, 2))
        t = np.linspace(0, 1, 9)[:, None]
        curve = (1 - t) ** 2 * points[0] + 2 * t * (1 - t) * points[1] + t**2 * points[2]
        canvas.add_path(curve, np.full(len(curve), radius))
    return canvas.alpha


SOLID_SHAPES: dict[str, Shape] = {"blob": _blob, "card": _card, "polygon": _polygon}
OPEN_SHAPES: dict[str, Shape] = {"foliage": _foliage, "ring": _ring, "scribble": _scribble}
THIN_SHAPES: dict[str, Shape] = {"blades": _blades, "branch": _branch, "fence": _fence}

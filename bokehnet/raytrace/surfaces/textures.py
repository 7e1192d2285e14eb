"""Random surface textures: scene-linear RGB (H, W, 3), float32, from a NumPy generator."""

from collections.abc import Callable

import numpy as np

from bokehnet.raytrace.surfaces.shapes import SOLID_SHAPES, Canvas, draw_shape

__all__ = [
    "TEXTURES",
    "checkers",
    "dead_leaves",
    "fractal_colours",
    "fractal_noise",
    "glyph_page",
    "grating",
    "light_points",
    "random_colour",
]

Texture = Callable[[int, int, np.random.Generator], np.ndarray]


def random_colour(rng: np.random.Generator) -> np.ndarray:
    """Return a random colour (3,), dark to bright, mostly of low saturation."""
    grey = np.exp(rng.uniform(np.log(0.02), np.log(0.9)))
    colour: np.ndarray = np.clip(grey * np.exp(rng.normal(0, 0.5, 3)), 0.005, 1.0)
    return colour.astype(np.float32)


def fractal_noise(height: int, width: int, rng: np.random.Generator, power: float = 1.5) -> np.ndarray:
    """Return noise (H, W) in [0, 1] with amplitude proportional to frequency to the minus ``power``.

    Photographs have a power near 1 (Field, "Relations between the statistics of natural images and the
    response properties of cortical cells", 1987); larger powers are smoother.
    """
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None])
    frequency[0, 0] = 1
    spectrum = np.fft.rfft2(rng.normal(size=(height, width))) / frequency**power
    spectrum[0, 0] = 0
    noise = np.fft.irfft2(spectrum, (height, width))
    spread = 2.5 * noise.std()
    return np.clip(0.5 + noise / (2 * spread if spread > 0 else 1), 0, 1).astype(np.float32)


def fractal_colours(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Return clouds of three colours."""
    first, second, third = (random_colour(rng) for _ in range(3))
    mix, shade = (fractal_noise(height, width, rng, rng.uniform(0.9, 2))[..., None] for _ in range(2))
    colours: np.ndarray = (first * (1 - mix) + second * mix) * shade + third * (1 - shade)
    return colours


def dead_leaves(
    height: int, width: int, rng: np.random.Generator, paint: Texture | None = None
) -> np.ndarray:
    """Return occluding shapes of power-law sizes, in plain colours or with the texture ``paint``.

    Source:
        Lee, Mumford and Huang, "Occlusion models for natural images", 2001.
    """
    picture = np.broadcast_to(random_colour(rng), (height, width, 3)).astype(np.float32)
    size = max(height, width)
    smallest, largest = 0.03 * size, 0.5 * size
    painted = None if paint is None else paint(height, width, rng)
    count = int(rng.integers(60, 160))
    # Sizes with density r**-3, by inversion, in random order.
    chance = rng.random(count)
    sizes = (smallest**-2 + chance * (largest**-2 - smallest**-2)) ** -0.5
    for extent in sizes:
        h, w = (max(3, int(extent * rng.uniform(0.6, 1.6))) for _ in range(2))
        top, left = int(rng.integers(1 - h, height)), int(rng.integers(1 - w, width))
        alpha = draw_shape(SOLID_SHAPES, h, w, rng)
        rows, columns = slice(max(top, 0), min(top + h, height)), slice(max(left, 0), min(left + w, width))
        alpha = alpha[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left, None]
        colour = random_colour(rng)
        if painted is not None and rng.random() < 0.6:
            y, x = rng.integers(0, height - alpha.shape[0] + 1), rng.integers(0, width - alpha.shape[1] + 1)
            colour = painted[y : y + alpha.shape[0], x : x + alpha.shape[1]]
        picture[rows, columns] += alpha * (colour - picture[rows, columns])
    return picture


def grating(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Return stripes of two colours, hard or soft, with a period of at least four texels."""
    period = np.exp(rng.uniform(np.log(4), np.log(max(height, width) / 2 + 4)))
    angle = rng.uniform(0, np.pi)
    x, y = np.arange(width)[None], np.arange(height)[:, None]
    wave = np.sin((x * np.cos(angle) + y * np.sin(angle)) * 2 * np.pi / period + rng.uniform(0, 7))
    mix = _soften(wave, 2 * np.pi / period) if rng.random() < 0.5 else 0.5 + 0.5 * wave
    return _mix(mix, rng)


def checkers(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Return a checkerboard of two colours."""
    period = np.exp(rng.uniform(np.log(8), np.log(max(height, width) + 8)))
    x, y = (np.arange(size) * 2 * np.pi / period for size in (width, height))
    wave = [2 * _soften(np.sin(axis + rng.uniform(0, 7)), 2 * np.pi / period) - 1 for axis in (x, y)]
    return _mix(0.5 + 0.5 * wave[1][:, None] * wave[0][None], rng)


def glyph_page(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
    """Return rows of small strokes, like a page of text."""
    canvas = Canvas(height, width)
    line = rng.uniform(7, 20)
    glyph = 0.55 * line
    for top in np.arange(0.4 * line, height - line, line):
        left = 0.5 * line
        while left < width - line:
            if rng.random() < 0.85:
                for _ in range(rng.integers(1, 4)):
                    ends = rng.choice([0.0, 0.5, 1.0], (2, 2)) * [0.75 * glyph, glyph] + [left, top]
                    canvas.add_stroke(ends[0], ends[1], 0.09 * glyph, 0.09 * glyph)
            left += glyph
    return _mix(canvas.alpha, rng)


def light_points(
    height: int,
    width: int,
    rng: np.random.Generator,
    radius: tuple[float, float] = (0.8, 2.5),
    peak: tuple[float, float] = (5.0, 300.0),
) -> tuple[np.ndarray, np.ndarray]:
    """Return small lamps on a transparent background: colour (H, W, 3) and alpha (H, W).

    Args:
        height: Height, texels.
        width: Width, texels.
        rng: Random generator.
        radius: Minimum and maximum radius of a lamp, texels.
        peak: Minimum and maximum radiance.
    """
    colour, alpha = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32)
    base = np.exp(rng.uniform(np.log(peak[0]), np.log(peak[1])))
    for _ in range(rng.integers(4, 40)):
        size = rng.uniform(*radius)
        lamp = Canvas(height, width)
        centre = rng.uniform(size + 1, np.maximum([width - size - 1, height - size - 1], size + 1))
        lamp.add_stroke(centre, centre, size, size)
        inside = lamp.alpha > 0
        tint = np.exp(rng.normal(0, 0.35, 3)) * [1.2, 1.0, rng.uniform(0.3, 1.0)]
        colour[inside] = np.clip(base * np.exp(rng.normal(0, 0.5)) * tint, 0, 2 * peak[1])
        alpha = np.maximum(alpha, lamp.alpha)
    return colour, alpha


def _soften(wave: np.ndarray, slope: float) -> np.ndarray:
    """Return a sine as a square wave in [0, 1] with edges one texel wide; ``slope`` in 1/texel."""
    edges: np.ndarray = np.clip(0.5 + wave / slope, 0, 1)
    return edges


def _mix(mix: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    low, high = random_colour(rng), random_colour(rng)
    return (low + mix[..., None] * (high - low)).astype(np.float32)


TEXTURES: dict[str, Texture] = {
    "checkers": checkers,
    "dead_leaves": dead_leaves,
    "fractal": fractal_colours,
    "glyphs": glyph_page,
    "grating": grating,
}

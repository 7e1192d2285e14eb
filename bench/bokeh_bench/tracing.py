"""Distribution ray tracing through a thin lens, in NumPy.

A pixel at ``p`` (pixels from the centre) and a pupil point ``u`` of the unit disc define a ray that passes
at the depth z through the image position ``p - r(z) u``, with the signed blur radius ``r(z) = blur (1/z -
1/focus)`` in pixels, above 0 in front of focus. The pinhole picture and its depth have ``blur = 0``.

Lamps that are smaller than their blur are sampled by points of the lamp instead of points of the pupil: the
light of a pixel is the integral over the lamp's image of its radiance, over the area of the pupil's image.
Else a few rays of hundreds would hit them.

Source: Cook, Porter and Carpenter, "Distributed ray tracing", SIGGRAPH 1984.
"""

from dataclasses import dataclass, replace

import numpy as np

from bokeh_bench.surfaces import Card, Surface, Texture

__all__ = ["SKY_DEPTH", "Camera", "blur_radius", "pinhole_depth", "render", "trace"]

# Depth of the sky, metres.
SKY_DEPTH = 1e10

# Number of rays of one step: a compromise of memory and calls.
_CHUNK = 1 << 18

# Samples of a lamp for each pixel that its blur can reach.
_LAMP_SAMPLES = 64

_BLACK = Texture(color=(0.0, 0.0, 0.0), waves=np.zeros((0, 4), np.float32))


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Camera of fixed scale: focusing does not zoom.

    Attributes:
        width: Pixels.
        height: Pixels.
        slope: Change of slope from one pixel to the next.
        blur: Blur radius in pixels for one inverse metre of distance from focus.
        focus: Distance in focus, metres.
        blades: Number of straight blades; 0 is a disc.
        shift: Position of the camera along x, metres.
    """

    width: int
    height: int
    slope: float
    blur: float = 0.0
    focus: float = 1.0
    blades: int = 0
    shift: float = 0.0


def blur_radius(camera: Camera, depth: np.ndarray) -> np.ndarray:
    """Return the signed blur radius in pixels at depths in metres, above 0 in front of focus."""
    return np.asarray(camera.blur * (1 / np.asarray(depth, np.float64) - 1 / camera.focus))


def _pupil(camera: Camera, rng: np.random.Generator, count: int, samples: int) -> np.ndarray:
    """Return random points of the pupil, (count * samples, 2), stratified among the samples of a pixel."""
    side = int(np.sqrt(samples))
    cells = np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)
    first = rng.random((count, samples, 2), np.float32)
    order = np.argsort(rng.random((count, side * side), np.float32), axis=1)
    first[:, : side * side] = (cells[order] + first[:, : side * side]) / side
    radius = np.sqrt(first[..., 0]).ravel()
    angle = (2 * np.pi * first[..., 1]).ravel()
    if camera.blades:
        # Equal-area map of the disc to the polygon: the same fraction of each triangle.
        sector = 2 * np.pi / camera.blades
        index = np.floor(angle / sector)
        along = angle / sector - index
        low, high = index * sector, (index + 1) * sector
        x = radius * ((1 - along) * np.cos(low) + along * np.cos(high))
        y = radius * ((1 - along) * np.sin(low) + along * np.sin(high))
        return np.stack([x, y], -1)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)


def _visible(surface: Surface, camera: Camera, rows: tuple[int, int]) -> bool:
    """Return whether a surface can be seen from a range of rows."""
    reach = surface.reach()
    if reach is None:
        return True
    depth, radius = reach
    nearest = depth - radius
    if nearest <= 0.05:
        return True
    middle = surface.center[1] / depth / camera.slope + camera.height / 2
    extent = (
        radius / nearest / camera.slope + abs(surface.center[1]) * (1 / nearest - 1 / depth) / camera.slope
    )
    extent += float(np.abs(blur_radius(camera, np.array([nearest, depth + radius]))).max()) + 2
    return middle + extent >= rows[0] and middle - extent <= rows[1]


def trace(
    surfaces: list[Surface], sky: np.ndarray, origin: np.ndarray, slope: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return colour (N, 3), depth (N,) and surface index (N,) of rays; the sky has index -1."""
    depth = np.full(len(origin), np.inf, np.float32)
    index = np.full(len(origin), -1)
    for number, surface in enumerate(surfaces):
        hit = surface.hit(origin, slope)
        nearer = hit < depth
        depth[nearer], index[nearer] = hit[nearer], number
    fraction = np.clip(0.5 + slope[:, 1:2], 0, 1)
    color = np.asarray(sky[0] + fraction * (sky[1] - sky[0]), np.float32)
    for number, surface in enumerate(surfaces):
        mine = np.nonzero(index == number)[0]
        if len(mine):
            color[mine] = surface.color(origin[mine], slope[mine], depth[mine])
    return color, depth, index


def _is_sampled(surface: Surface, camera: Camera) -> bool:
    """Return whether a surface is a lamp that is smaller than its blur."""
    if not isinstance(surface, Card) or not surface.lamp:
        return False
    radius = surface.outline.size[0] / surface.center[2] / camera.slope
    return bool(abs(float(blur_radius(camera, np.asarray(surface.center[2])))) > radius)


def _add_lamp(
    picture: np.ndarray, surfaces: list[Surface], number: int, sky: np.ndarray, camera: Camera, seed: int
) -> None:
    """Add the light of a lamp to the pixels that its blur can reach."""
    lamp = surfaces[number]
    assert isinstance(lamp, Card)
    depth, scale = lamp.center[2], lamp.center[2] * camera.slope
    blur, radius = float(blur_radius(camera, np.asarray(depth))), lamp.outline.size[0] / scale
    middle = np.array([lamp.center[0] - camera.shift, lamp.center[1]]) / scale
    reach = abs(blur) + radius + 1
    x0, y0 = (
        int(max(0, np.floor(m + n / 2 - reach))) for m, n in zip(middle, picture.shape[1::-1], strict=True)
    )
    x1, y1 = (
        int(min(n, np.ceil(m + n / 2 + reach))) for m, n in zip(middle, picture.shape[1::-1], strict=True)
    )
    if x0 >= x1 or y0 >= y1:
        return
    y, x = (part.ravel() for part in np.mgrid[y0:y1, x0:x1])
    rng = np.random.default_rng((seed, 7919, number))
    pixel = np.stack([x - camera.width / 2, y - camera.height / 2], -1).repeat(_LAMP_SAMPLES, 0)
    pixel = pixel + rng.random(pixel.shape)
    distance, angle = radius * np.sqrt(rng.random(len(pixel))), 2 * np.pi * rng.random(len(pixel))
    point = middle + np.stack([distance * np.cos(angle), distance * np.sin(angle)], -1)
    pupil = (pixel - point) / blur
    inside = np.nonzero(_in_pupil(camera, pupil))[0]
    light = np.zeros((len(pixel), 3))
    origin, slope = _rays(camera, pixel[inside], pupil[inside])
    color, _, index = trace(surfaces, sky, origin, slope)
    light[inside] = np.where((index == number)[:, None], color, 0)
    factor = np.pi * radius**2 / (_pupil_area(camera) * blur**2)
    mean = light.reshape(-1, _LAMP_SAMPLES, 3).mean(1).reshape(y1 - y0, x1 - x0, 3)
    picture[y0:y1, x0:x1] += (factor * mean).astype(np.float32)


def _pupil_area(camera: Camera) -> float:
    """Return the area of the pupil in a circle of radius 1."""
    blades = camera.blades
    return 0.5 * blades * float(np.sin(2 * np.pi / blades)) if blades else float(np.pi)


def _in_pupil(camera: Camera, pupil: np.ndarray) -> np.ndarray:
    """Return the mask of points (N, 2) inside the disc, or the polygon with a corner at angle 0."""
    radius = np.hypot(pupil[:, 0], pupil[:, 1])
    if not camera.blades:
        return np.asarray(radius <= 1)
    sector = 2 * np.pi / camera.blades
    angle = np.mod(np.arctan2(pupil[:, 1], pupil[:, 0]), sector) - sector / 2
    return np.asarray(radius * np.cos(angle) <= np.cos(sector / 2))


def render(surfaces: list[Surface], sky: np.ndarray, camera: Camera, samples: int, seed: int) -> np.ndarray:
    """Render a scene-linear picture (H, W, 3), float32, with a box filter of one pixel.

    Args:
        surfaces: Surfaces of the scene.
        sky: Colours of the zenith and of the ground's horizon, (2, 3).
        camera: Camera with its lens.
        samples: Rays per pixel.
        seed: Seed of the rays.
    """
    picture = np.empty((camera.height, camera.width, 3), np.float32)
    sampled = [number for number, surface in enumerate(surfaces) if _is_sampled(surface, camera)]
    black = [
        replace(surface, texture=_BLACK) if n in sampled else surface for n, surface in enumerate(surfaces)
    ]
    rows = max(1, _CHUNK // (camera.width * samples))
    for first in range(0, camera.height, rows):
        last = min(first + rows, camera.height)
        rng = np.random.default_rng((seed, first))
        count = (last - first) * camera.width
        y, x = np.divmod(np.arange(count), camera.width)
        pixel = np.stack([x - camera.width / 2, y + first - camera.height / 2], -1).astype(np.float32)
        pixel = np.repeat(pixel, samples, 0) + rng.random((count * samples, 2), np.float32)
        pupil = _pupil(camera, rng, count, samples).astype(np.float32)
        origin, slope = _rays(camera, pixel, pupil)
        seen = [surface for surface in black if _visible(surface, camera, (first, last))]
        color = trace(seen, sky, origin, slope)[0]
        picture[first:last] = color.reshape(count, samples, 3).mean(1).reshape(last - first, camera.width, 3)
    for number in sampled:
        _add_lamp(picture, surfaces, number, sky, camera, seed)
    return picture


def _rays(camera: Camera, pixel: np.ndarray, pupil: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return origins (N, 2) at z = 0 and slopes (N, 2): x(z) = slope_px ((p + blur u / focus) z - blur u)."""
    scale = camera.slope * camera.blur
    origin = -scale * np.asarray(pupil, np.float32)
    origin[:, 0] += camera.shift
    return origin, np.asarray(camera.slope * pixel + scale / camera.focus * pupil, np.float32)


def pinhole_depth(surfaces: list[Surface], sky: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the depth of the pixels' centres, metres, (H, W); the sky has ``SKY_DEPTH``."""
    y, x = np.divmod(np.arange(camera.width * camera.height), camera.width)
    pixel = np.stack([x + 0.5 - camera.width / 2, y + 0.5 - camera.height / 2], -1)
    pinhole = np.zeros(pixel.shape)
    origin = pinhole.copy()
    origin[:, 0] += camera.shift
    depth = trace(surfaces, sky, origin, camera.slope * pixel)[1]
    return np.minimum(depth, SKY_DEPTH).reshape(camera.height, camera.width).astype(np.float64)

"""Accumulated views of meshes at a cost adapted to the blur: thesis 002, 3.1 to 3.4.

Every view is a pinhole picture from a point of the pupil, drawn by a rasteriser with a depth buffer. Three
optimizations: objects with wide blur are drawn with fewer triangles; views in which an object falls on the
same pixels share its picture; and each view is blurred by the views between it and its neighbours
(:func:`subsample_blur`).

Faults: an object has a single level of detail, even if its blur varies; shared pictures are shifted by whole
    pixels, so sharp regions are not antialiased.

Source: Jeong et al., "Real-time defocus rendering with level of detail and sub-sample blur", Computer
Graphics Forum 2013, after thesis 002, eqs. 3.3 and 3.4; Haeberli and Akeley, SIGGRAPH 1990.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from bokehnet.baselines.rays.n_buffers import radius_bounds
from bokehnet.checks import check_whole
from bokehnet.errors import ParameterError
from bokehnet.kernels import njit
from bokehnet.lenses.thin import ThinLens
from bokehnet.optics.sampling import disc_from_square, halton

__all__ = ["MeshObject", "Picture", "Views", "draw", "level_of_detail", "render_views", "subsample_blur"]

# Maximum distance between a ray and a surface that it hits, pixels.
_HIT_TOLERANCE_PX = 1.0

# Iterations of the bounds of the search range.
_BOUND_ITERATIONS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshObject:
    """Object at several levels of detail.

    Attributes:
        levels: For each level, from the finest to the coarsest with half as many triangles each: vertices (V,
            3), mm, in front of the lens; their colours (V, 3), scene-linear; and triangles (F, 3).

    Raises:
        ParameterError: There is no level, or a level without triangles.
    """

    levels: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]

    def __post_init__(self) -> None:
        if not self.levels or any(not len(faces) for _, _, faces in self.levels):
            raise ParameterError("levels", "one or more, with triangles", shown="none or an empty one")

    @property
    def depths(self) -> tuple[float, float]:
        """Minimum and maximum depth, mm."""
        z = self.levels[0][0][:, 2]
        return float(z.min()), float(z.max())


@dataclass(frozen=True, kw_only=True)
class Picture:
    """Sensor: width and height in pixels, and pixel pitch, mm."""

    width: int
    height: int
    pixel_pitch: float


@dataclass(frozen=True, kw_only=True)
class Views:
    """Result of :func:`render_views`: the mean picture (H, W, 3), and the number of drawn triangles."""

    bokeh: np.ndarray
    triangles: int


def level_of_detail(blur_area: float, sphere_area: float, triangles: int, factor: float = 2.0) -> float:
    """Return the level of an object as a real number: ``max(log_s(C / A), 0)`` with ``A = A_b / (N_t / 2)``.

    Args:
        blur_area: Area of its smallest disc of confusion, pixels^2.
        sphere_area: Area of its bounding sphere in the picture, pixels^2.
        triangles: Number of triangles of its finest level.
        factor: Ratio of the number of triangles of consecutive levels.
    """
    size = sphere_area / (0.5 * triangles)
    return max(math.log(max(blur_area, 1e-12) / size, factor), 0.0)


@njit(cache=True)
def draw(corners, colors, faces, scale, shift_x, shift_y, lens_x, lens_y, light, inverse):
    """Draw triangles into ``light`` (H, W, 3) and the buffer ``inverse`` (H, W) of inverse depth, 1/mm.

    Args:
        corners: Vertices, mm, (V, 3); triangles behind the lens plane are skipped.
        colors: Colours, (V, 3).
        faces: Triangles, (F, 3).
        scale: Pixels per unit of slope.
        shift_x: Shift of the view to the right that keeps the plane of focus in place, pixels.
        shift_y: Shift downwards, pixels.
        lens_x: Pupil point, to the right, mm.
        lens_y: Pupil point, downwards, mm.
        light: Scene-linear picture.
        inverse: Inverse depth; larger is nearer.
    """
    height, width = inverse.shape
    projected = np.empty((len(corners), 3))
    for v in range(len(corners)):
        z = corners[v, 2]
        projected[v, 0] = (corners[v, 0] - lens_x) / z * scale + shift_x
        projected[v, 1] = (corners[v, 1] - lens_y) / z * scale + shift_y
        projected[v, 2] = 1.0 / z
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if projected[a, 2] <= 0.0 or projected[b, 2] <= 0.0 or projected[c, 2] <= 0.0:
            continue
        x0, y0, x1, y1 = projected[a, 0], projected[a, 1], projected[b, 0], projected[b, 1]
        x2, y2 = projected[c, 0], projected[c, 1]
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if area == 0.0:
            continue
        left = max(0, int(math.ceil(min(x0, x1, x2) - 0.5)))
        right = min(width - 1, int(math.floor(max(x0, x1, x2) - 0.5)))
        top = max(0, int(math.ceil(min(y0, y1, y2) - 0.5)))
        bottom = min(height - 1, int(math.floor(max(y0, y1, y2) - 0.5)))
        for j in range(top, bottom + 1):
            for i in range(left, right + 1):
                x, y = i + 0.5, j + 0.5
                u = ((x1 - x) * (y2 - y) - (x2 - x) * (y1 - y)) / area
                v = ((x2 - x) * (y0 - y) - (x0 - x) * (y2 - y)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                near = u * projected[a, 2] + v * projected[b, 2] + w * projected[c, 2]
                if near <= inverse[j, i]:
                    continue
                inverse[j, i] = near
                for k in range(3):
                    total = u * projected[a, 2] * colors[a, k] + v * projected[b, 2] * colors[b, k]
                    light[j, i, k] = (total + w * projected[c, 2] * colors[c, k]) / near


# Function of colours (H, W, 3) and inverse depth (H, W), 1/mm, of a view; returns the blurred view.
Blur = Callable[[np.ndarray, np.ndarray], np.ndarray]


def render_views(
    objects: list[MeshObject],
    lens: ThinLens,
    picture: Picture,
    views: int,
    *,
    finer: float | None = None,
    reuse: bool = False,
    blur: Blur | None = None,
) -> Views:
    """Return the mean of ``views`` pinhole pictures on a black background.

    Args:
        objects: Objects of the scene.
        lens: Focused lens.
        picture: Sensor.
        views: Number of pupil points, at least 1.
        finer: Select the level of detail of an object by its blur, this number of levels finer than the
            formula, as colours below the size of the blur remain visible; for a fractional level, that
            fraction of the views uses the coarser level. None draws the finest level.
        reuse: Draw an object once for all views in which it falls on the same whole pixels.
        blur: Function that blurs each view.

    Raises:
        ParameterError: ``views`` is below 1.
    """
    check_whole("views", views, 1)
    points = disc_from_square(np.stack([halton(views, 2), halton(views, 7)], -1))
    scale = lens.sensor_distance / picture.pixel_pitch
    size = (picture.height, picture.width)
    light, inverse = np.zeros((views, *size, 3), np.float32), np.zeros((views, *size), np.float32)
    drawn = 0
    for mesh_object in objects:
        level = 0.0 if finer is None else max(_level(mesh_object, lens, picture, scale) - finer, 0.0)
        for detail_level, group in _groups(mesh_object, lens, picture, points, level, reuse):
            corners, colors, faces = mesh_object.levels[detail_level]
            parent = group[0]
            drawn += len(faces)
            shared = [np.zeros((*size, 3), np.float32), np.zeros(size, np.float32)]
            target = shared if len(group) > 1 else [light[parent], inverse[parent]]
            x, y = points[parent] * lens.pupil_radius
            middle = (
                picture.width / 2 + x / lens.focus_distance * scale,
                picture.height / 2 + y / lens.focus_distance * scale,
            )
            draw(corners, colors, faces, scale, *middle, x, y, *target)
            if len(group) > 1:
                rows, columns = np.nonzero(shared[1])
                for view in group if len(rows) else ():
                    nearer = shared[1][rows, columns] > inverse[view, rows, columns]
                    pixels = (view, rows[nearer], columns[nearer])
                    inverse[pixels], light[pixels] = shared[1][pixels[1:]], shared[0][pixels[1:]]
    mean = np.zeros((*size, 3))
    for view in range(views):
        mean += light[view] if blur is None else blur(light[view], inverse[view])
    return Views(bokeh=(mean / views).astype(np.float32), triangles=drawn)


def _level(mesh_object: MeshObject, lens: ThinLens, picture: Picture, scale: float) -> float:
    """Return the level of an object by the formula, at most its coarsest."""
    corners = mesh_object.levels[0][0]
    low, high = corners.min(0), corners.max(0)
    radius = float(np.linalg.norm(high - low)) / 2 / float((low[2] + high[2]) / 2) * scale
    radii = [float(lens.coc_radius(1 / z)) / picture.pixel_pitch for z in mesh_object.depths]
    min_radius = 0.0 if radii[0] * radii[1] <= 0 else min(abs(radius_of_end) for radius_of_end in radii)
    level = level_of_detail(math.pi * min_radius**2, math.pi * radius**2, len(mesh_object.levels[0][2]))
    return min(level, len(mesh_object.levels) - 1.0)


def _groups(
    mesh_object: MeshObject, lens: ThinLens, picture: Picture, points: np.ndarray, level: float, reuse: bool
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield levels and the views that share one drawing of an object; the first view is the drawn one."""
    views = np.arange(len(points))
    fine = int(level)
    coarse_count = round((level - fine) * len(points))
    parts = [(fine, views[: len(points) - coarse_count]), (fine + 1, views[len(points) - coarse_count :])]
    reach = max(abs(float(lens.coc_radius(1 / z))) for z in mesh_object.depths) / picture.pixel_pitch
    for detail_level, members in parts:
        if not reuse:
            yield from ((detail_level, members[i : i + 1]) for i in range(len(members)))
            continue
        bins = np.round(reach * points[members]).astype(np.int64)
        off = np.abs(reach * points[members] - bins).max(axis=1)
        for bin_index in np.unique(bins, axis=0):
            inside = np.flatnonzero((bins == bin_index).all(axis=1))
            yield detail_level, members[inside[np.argsort(off[inside], kind="stable")]]


@njit(cache=True)
def subsample_blur(light, radius, points, low, high):
    """Return the mean (H, W, 3) of a view and of rays through pupil points around it.

    The view is a height field. A ray through a point of the pupil hits the surface whose blur displaces it by
    the distance between ray and pixel. N-buffers bound the blur around each pixel and thus the search range.
    Rays without a hit use the view's own colour, as a single layer has nothing behind its surfaces.

    Args:
        light: Picture of the view, (H, W, 3).
        radius: Signed blur radius of its pixels in pixels, + in front of focus, (H, W).
        points: Pupil points relative to that of the view, in pupil radii, (S, 2).
        low: Minima of ``radius`` from :func:`bokehnet.baselines.rays.n_buffers.n_buffers`.
        high: Maxima of ``radius``.

    Source:
        Thesis 002, algorithms 3.2 and 3.3.
    """
    height, width = radius.shape
    result = np.empty((height, width, 3))
    for y in range(height):
        for x in range(width):
            min_radius, max_radius = low[-1, 0, 0], high[-1, 0, 0]
            for _ in range(_BOUND_ITERATIONS):
                pupil_distance = 0.0
                for s in range(len(points)):
                    pupil_distance = max(pupil_distance, math.hypot(points[s, 0], points[s, 1]))
                reach = int(
                    math.ceil(pupil_distance * max(abs(min_radius), abs(max_radius)) + _HIT_TOLERANCE_PX)
                )
                min_radius, max_radius = radius_bounds(low, high, y, x, reach)
            for k in range(3):
                result[y, x, k] = light[y, x, k]
            for s in range(len(points)):
                u, v = points[s, 0], points[s, 1]
                length = math.hypot(u, v)
                hit_y, hit_x = y, x
                steps = int(math.ceil((max_radius - min_radius) * max(abs(u), abs(v)))) + 1
                for step in range(steps + 1):  # the nearest surface first
                    r = max_radius - (max_radius - min_radius) * step / steps
                    j, i = y + int(round(r * v)), x + int(round(r * u))
                    if j < 0 or i < 0 or j >= height or i >= width:
                        continue
                    if abs(radius[j, i] - r) * length <= _HIT_TOLERANCE_PX:
                        hit_y, hit_x = j, i
                        break
                for k in range(3):
                    result[y, x, k] += light[hit_y, hit_x, k]
    return result / (len(points) + 1)

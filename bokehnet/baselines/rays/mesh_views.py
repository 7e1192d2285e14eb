"""Accumulated views of meshes, made cheaper where blur hides it: thesis 002, 3.1 to 3.4.

Every view is a pinhole picture from a point of the pupil, drawn by a rasteriser with a depth buffer. Three
ways to save: objects whose blur is wide are drawn by fewer triangles; views in which an object falls on the
same pixels share its picture; and each view is blurred by what lies between it and its neighbours
(:mod:`bokehnet.baselines.rays.subsample_blur`).

Faults: an object is at one level of detail, whatever of it is blurred; pictures that views share are moved by
whole pixels, so that what is sharp is not antialiased.

Source: Jeong et al., "Real-time defocus rendering with level of detail and sub-sample blur", Computer
Graphics Forum 2013, as thesis 002 tells it, eqs. 3.3 and 3.4; Haeberli and Akeley, SIGGRAPH 1990.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_whole
from bokehnet.errors import ParameterError
from bokehnet.kernels import njit
from bokehnet.lenses.thin import ThinLens
from bokehnet.optics.sampling import disc_from_square, halton

__all__ = ["MeshObject", "Picture", "Views", "draw", "level_of_detail", "render_views"]


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshObject:
    """An object at several levels of detail.

    Attributes:
        levels: Corners (V, 3), mm, in front of the lens; their colours (V, 3), scene-linear; and triangles
            (F, 3), from the finest level to the coarsest, each with half as many triangles.

    Raises:
        ParameterError: There is no level, or one without triangles.
    """

    levels: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]

    def __post_init__(self) -> None:
        if not self.levels or any(not len(faces) for _, _, faces in self.levels):
            raise ParameterError("levels", "one or more, with triangles", shown="none or an empty one")

    @property
    def depths(self) -> tuple[float, float]:
        """Least and largest depth, mm."""
        z = self.levels[0][0][:, 2]
        return float(z.min()), float(z.max())


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A sensor: width and height in pixels, and the distance between them, mm."""

    width: int
    height: int
    pixel_pitch: float


@dataclass(frozen=True, kw_only=True)
class Views:
    """What :func:`render_views` made: the mean picture (H, W, 3), and how many triangles were drawn."""

    bokeh: np.ndarray
    triangles: int


def level_of_detail(blur_area: float, sphere_area: float, triangles: int, factor: float = 2.0) -> float:
    """Level of an object as a real number: ``max(log_s(C / A), 0)`` with ``A = A_b / (N_t / 2)``.

    Args:
        blur_area: Of its smallest disc of confusion, pixels^2.
        sphere_area: Of its bounding sphere in the picture, pixels^2.
        triangles: Of its finest level.
        factor: By which a level has fewer triangles than the one before.
    """
    size = sphere_area / (0.5 * triangles)
    return max(math.log(max(blur_area, 1e-12) / size, factor), 0.0)


@njit(cache=True)
def draw(corners, colors, faces, scale, shift_x, shift_y, lens_x, lens_y, light, inverse):  # type: ignore[no-untyped-def]
    """Draw triangles into ``light`` (H, W, 3) and the buffer ``inverse`` (H, W) of inverse depth, 1/mm.

    Args:
        corners: mm, (V, 3); behind the lens's plane nothing is drawn.
        colors: (V, 3).
        faces: (F, 3).
        scale: Pixels per unit of slope.
        shift_x: Pixels by which the view is moved so that the plane of focus stays in place.
        shift_y: The same, down.
        lens_x: Point of the pupil, mm.
        lens_y: The same, down.
        light: Scene-linear.
        inverse: Larger is nearer.
    """
    height, width = inverse.shape
    place = np.empty((len(corners), 3))
    for v in range(len(corners)):
        z = corners[v, 2]
        place[v, 0] = (corners[v, 0] - lens_x) / z * scale + shift_x
        place[v, 1] = (corners[v, 1] - lens_y) / z * scale + shift_y
        place[v, 2] = 1.0 / z
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if place[a, 2] <= 0.0 or place[b, 2] <= 0.0 or place[c, 2] <= 0.0:
            continue
        x0, y0, x1, y1 = place[a, 0], place[a, 1], place[b, 0], place[b, 1]
        x2, y2 = place[c, 0], place[c, 1]
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
                near = u * place[a, 2] + v * place[b, 2] + w * place[c, 2]
                if near <= inverse[j, i]:
                    continue
                inverse[j, i] = near
                for k in range(3):
                    total = u * place[a, 2] * colors[a, k] + v * place[b, 2] * colors[b, k]
                    light[j, i, k] = (total + w * place[c, 2] * colors[c, k]) / near


# Colours (H, W, 3) and inverse depth (H, W), 1/mm, of a view; gives it blurred.
Blur = Callable[[np.ndarray, np.ndarray], np.ndarray]


def render_views(
    objects: list[MeshObject],
    lens: ThinLens,
    picture: Picture,
    views: int,
    *,
    levels: bool = False,
    finer: float = 0.0,
    reuse: bool = False,
    blur: Blur | None = None,
) -> Views:
    """Return the mean of ``views`` pinhole pictures; black where there is nothing.

    Args:
        objects: What is there.
        lens: Focused.
        picture: Sensor.
        views: How many points of the pupil, from 1 up.
        levels: Draw objects by as many triangles as their blur asks for; of a level between two, so large a
            share of the views is drawn by the coarser one.
        finer: By how many levels finer than the formula says, as colours of a size below the blur still show.
        reuse: Draw an object once for all views in which it falls on the same whole pixels.
        blur: Blurs each view.

    Raises:
        ParameterError: Less than one view.
    """
    check_whole("views", views, 1)
    points = disc_from_square(np.stack([halton(views, 2), halton(views, 7)], -1))
    scale = lens.sensor_distance / picture.pixel_pitch
    size = (picture.height, picture.width)
    light, inverse = np.zeros((views, *size, 3), np.float32), np.zeros((views, *size), np.float32)
    drawn = 0
    for thing in objects:
        level = max(_level(thing, lens, picture, scale) - finer, 0.0) if levels else 0.0
        for chosen, group in _groups(thing, lens, picture, points, level, reuse):
            corners, colors, faces = thing.levels[chosen]
            parent = group[0]
            drawn += len(faces)
            own = [np.zeros((*size, 3), np.float32), np.zeros(size, np.float32)]
            target = own if len(group) > 1 else [light[parent], inverse[parent]]
            x, y = points[parent] * lens.pupil_radius
            middle = (
                picture.width / 2 + x / lens.focus_distance * scale,
                picture.height / 2 + y / lens.focus_distance * scale,
            )
            draw(corners, colors, faces, scale, *middle, x, y, *target)
            if len(group) > 1:
                rows, columns = np.nonzero(own[1])
                for view in group if len(rows) else ():
                    before = own[1][rows, columns] > inverse[view, rows, columns]
                    here = (view, rows[before], columns[before])
                    inverse[here], light[here] = own[1][here[1:]], own[0][here[1:]]
    mean = np.zeros((*size, 3))
    for view in range(views):
        mean += light[view] if blur is None else blur(light[view], inverse[view])
    return Views(bokeh=(mean / views).astype(np.float32), triangles=drawn)


def _level(thing: MeshObject, lens: ThinLens, picture: Picture, scale: float) -> float:
    """Level of an object by the formula, at most its coarsest."""
    corners = thing.levels[0][0]
    low, high = corners.min(0), corners.max(0)
    radius = float(np.linalg.norm(high - low)) / 2 / float((low[2] + high[2]) / 2) * scale
    radii = [float(lens.coc_radius(1 / z)) / picture.pixel_pitch for z in thing.depths]
    least = 0.0 if radii[0] * radii[1] <= 0 else min(abs(one) for one in radii)
    level = level_of_detail(math.pi * least**2, math.pi * radius**2, len(thing.levels[0][2]))
    return min(level, len(thing.levels) - 1.0)


def _groups(
    thing: MeshObject, lens: ThinLens, picture: Picture, points: np.ndarray, level: float, reuse: bool
) -> Iterator[tuple[int, np.ndarray]]:
    """Levels, and the views that one drawing of an object at it serves, the first of them its own."""
    views = np.arange(len(points))
    fine = int(level)
    share = round((level - fine) * len(points))
    parts = [(fine, views[: len(points) - share]), (fine + 1, views[len(points) - share :])]
    reach = max(abs(float(lens.coc_radius(1 / z))) for z in thing.depths) / picture.pixel_pitch
    for chosen, members in parts:
        if not reuse:
            yield from ((chosen, members[i : i + 1]) for i in range(len(members)))
            continue
        bins = np.round(reach * points[members]).astype(np.int64)
        off = np.abs(reach * points[members] - bins).max(axis=1)
        for place in np.unique(bins, axis=0):
            inside = np.flatnonzero((bins == place).all(axis=1))
            yield chosen, members[inside[np.argsort(off[inside], kind="stable")]]

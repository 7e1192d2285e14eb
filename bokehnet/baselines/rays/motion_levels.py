"""Level of detail for motion blur: thesis 002, 3.6, which proposes it and leaves it open.

The displacement of an object during the exposure takes the place of its circle of confusion. Two groups of
evenly spread times carry the two levels next to the real-numbered one, so that no level pops: as the object
accelerates, times move from one group to the other.

Faults: as of levels for defocus: a texture across the motion loses detail that the motion does not blur.

Source: Jeong, "Efficient and expressive rendering for real-time defocus blur and bokeh", dissertation, 3.6.
"""

import math

import numpy as np

from bokehnet.baselines.rays.mesh_views import MeshObject, Picture, Views, draw, level_of_detail
from bokehnet.checks import check_whole
from bokehnet.lenses.thin import ThinLens

__all__ = ["motion_level", "moving_views", "times_by_level"]


def motion_level(displacement: float, sphere_area: float, triangles: int) -> float:
    """Return the level of a moving object: (3.3) with the area of a disc whose diameter is its displacement.

    Args:
        displacement: Displacement during the exposure, pixels.
        sphere_area: Area of its bounding sphere in the picture, pixels^2.
        triangles: Number of triangles of its finest level.
    """
    return level_of_detail(math.pi * (displacement / 2) ** 2, sphere_area, triangles)


def times_by_level(level: float, views: int, coarsest: int) -> list[tuple[int, np.ndarray]]:
    """Return the levels and the times of their views, 0 to 1; each group is evenly spread on its own.

    Args:
        level: Level as a real number.
        views: Number of all views.
        coarsest: Coarsest level.
    """
    level = min(level, float(coarsest))
    fine = int(level)
    coarse_count = round((level - fine) * views)
    groups = ((fine, views - coarse_count), (fine + 1, coarse_count))
    return [(number, (np.arange(count) + 0.5) / count) for number, count in groups if count]


def moving_views(
    objects: list[tuple[MeshObject, np.ndarray]],
    lens: ThinLens,
    picture: Picture,
    views: int,
    *,
    levels: bool = True,
    finer: float = 0.0,
) -> Views:
    """Return the mean of pinhole pictures of moving objects over the exposure, on a black background.

    Objects with views of two levels have two groups of times; a view shows each object at the time of its
    group that is nearest in rank, as all groups are sorted.

    Args:
        objects: Objects and their displacement during the exposure, mm, (3,).
        lens: Lens that gives the scale.
        picture: Sensor.
        views: Number of views, at least 1.
        levels: Select levels by displacement; False uses the finest.
        finer: Number of levels finer than the formula.
    """
    check_whole("views", views, 1)
    scale = lens.sensor_distance / picture.pixel_pitch
    size = (picture.height, picture.width)
    light, inverse = np.zeros((views, *size, 3), np.float32), np.zeros((views, *size), np.float32)
    drawn = 0
    for mesh, displacement in objects:
        corners = mesh.levels[0][0]
        low, high = corners.min(0), corners.max(0)
        depth = float(low[2] + high[2]) / 2
        radius = float(np.linalg.norm(high - low)) / 2 / depth * scale
        moved = float(np.hypot(displacement[0], displacement[1])) / depth * scale
        level = 0.0
        if levels:
            level = max(motion_level(moved, math.pi * radius**2, len(mesh.levels[0][2])) - finer, 0.0)
        schedule = [
            (time, number)
            for number, times in times_by_level(level, views, len(mesh.levels) - 1)
            for time in times
        ]
        for view, (time, number) in enumerate(sorted(schedule)):
            vertices, colors, faces = mesh.levels[number]
            drawn += len(faces)
            place = vertices + displacement * (time - 0.5)
            middle = picture.width / 2, picture.height / 2
            draw(place, colors, faces, scale, *middle, 0.0, 0.0, light[view], inverse[view])
    return Views(bokeh=light.mean(0), triangles=drawn)

"""Small bright lamps through a thin lens, by rays that sample the lamp directly."""

from dataclasses import dataclass

import numpy as np

from bokehnet.lenses import ThinLens
from bokehnet.optics.sampling import disc_from_square, halton, rotate_points
from bokehnet.synth.clutter.baked_scene import BakedScene, View, sensor_xy
from bokehnet.synth.clutter.grid_mesh import GridMesh, revolve
from bokehnet.synth.clutter.objects import rotation_about

__all__ = ["Lamp", "add_lamps", "lamp_body"]

# Rays per pixel to a blurred lamp, and to a lamp in focus, which covers few pixels but is bright.
_RAYS_BLURRED, _RAYS_IN_FOCUS = 64, 256


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Lamp:
    """Disc of uniform radiance that faces the lens.

    Attributes:
        centre: Centre (x, y, z), mm.
        radius: Radius, mm.
        radiance: Radiance, (3,).
    """

    centre: tuple[float, float, float]
    radius: float
    radiance: np.ndarray


def lamp_body(lamp: Lamp, texture: int) -> GridMesh:
    """Return the mesh of the disc, for a black texture: it occludes the background."""
    disc = revolve(np.array([[0.0, 0.0], [lamp.radius, 0.0]]), texture, 12)
    points = disc.points @ rotation_about(0, np.pi / 2).T + lamp.centre
    return GridMesh(points=points, uv=disc.uv, texture=texture, open=True)


def add_lamps(
    picture: np.ndarray, scene: BakedScene, lamps: tuple[Lamp, ...], lens: ThinLens, view: View, pupil: bool
) -> None:
    """Add the light of ``lamps`` to ``picture`` (H, W, 3); arguments are those of ``BakedScene.render``.

    If the blur disc is larger than the lamp, rays aim at random points of the lamp, weighted by the fraction
    of the pupil that the lamp covers; otherwise rays pass random points of the pupil.
    """
    pixels = sensor_xy(view)
    rng = np.random.default_rng([view.seed, 1])
    points = np.stack([halton(_RAYS_IN_FOCUS, base) for base in (2, 3, 5, 7)], -1).astype(np.float32)
    aperture = lens.pupil_radius if pupil else 0.0
    for lamp in lamps:
        depth = lamp.centre[2]
        # In the lamp's plane, a ray is offset from the pinhole ray by this fraction of its pupil point.
        leverage = 1 - depth / lens.focus_distance
        pitch = view.pixel_pitch / lens.sensor_distance * depth  # side of a pixel in the lamp's plane
        blur = aperture * abs(leverage)
        pinhole_xy = -pixels * np.float32(depth / lens.sensor_distance)
        offset = pinhole_xy - np.array(lamp.centre[:2], np.float32)
        near = np.flatnonzero((np.abs(offset) < lamp.radius + blur + pitch).all(-1))
        if not len(near):
            continue
        count = _RAYS_BLURRED if blur > lamp.radius else _RAYS_IN_FOCUS
        drawn = rotate_points(points[:count], rng.random((len(near), 1, 4), np.float32))
        position = pinhole_xy[near, None] + np.float32(pitch) * (drawn[..., 2:] - np.float32(0.5))
        disc = disc_from_square(drawn[..., :2])
        if blur > lamp.radius:
            target = np.array(lamp.centre[:2], np.float32) + np.float32(lamp.radius) * disc
            origin = (target - position) / np.float32(leverage)
            weight = (origin * origin).sum(-1) <= aperture**2
            fraction = (lamp.radius / blur) ** 2
        else:
            origin = np.float32(aperture) * disc
            target = position + np.float32(leverage) * origin
            weight = ((target - np.array(lamp.centre[:2])) ** 2).sum(-1) <= lamp.radius**2
            fraction = 1.0
        rows, columns = np.nonzero(weight)
        start, end = origin[rows, columns], target[rows, columns]
        hits = scene.intersect(start, (end - start) / np.float32(depth))
        clear = np.zeros(weight.shape)
        clear[rows, columns] = hits["tfar"] > depth * (1 - 1e-3)
        picture.reshape(-1, 3)[near] += (fraction * clear.mean(1))[:, None] * lamp.radiance

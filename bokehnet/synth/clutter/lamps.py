"""Small bright lamps through a thin lens: rays are sent to the lamp instead of waiting for one to meet it."""

from dataclasses import dataclass

import numpy as np

from bokehnet.lenses import ThinLens
from bokehnet.optics.sampling import disc_from_square, halton, rotate_points
from bokehnet.synth.clutter.baked_scene import BakedScene, View, sensor_xy
from bokehnet.synth.clutter.grid_mesh import GridMesh, revolve
from bokehnet.synth.clutter.objects import turn_about

__all__ = ["Lamp", "add_lamps", "lamp_body"]

# Rays of a pixel to a lamp that is blurred, and to one that is sharp: on few pixels, but bright.
_RAYS, _RAYS_WHERE_SHARP = 64, 256


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Lamp:
    """A disc that faces the lens and shines evenly.

    Attributes:
        centre: mm, (x, y, z).
        radius: mm.
        radiance: (3,).
    """

    centre: tuple[float, float, float]
    radius: float
    radiance: np.ndarray


def lamp_body(lamp: Lamp, texture: int) -> GridMesh:
    """The disc itself, to be black: it hides what is behind it."""
    disc = revolve(np.array([[0.0, 0.0], [lamp.radius, 0.0]]), texture, 12)
    points = disc.points @ turn_about(0, np.pi / 2).T + lamp.centre
    return GridMesh(points=points, uv=disc.uv, texture=texture, open=True)


def add_lamps(
    picture: np.ndarray, scene: BakedScene, lamps: tuple[Lamp, ...], lens: ThinLens, view: View, pupil: bool
) -> None:
    """Add the light of ``lamps`` to ``picture`` (H, W, 3); arguments are those of ``BakedScene.render``.

    A lamp whose blur disc is larger than itself is met by rays to random points of it, each weighted by
    the share of the pupil that it stands for; else random points of the pupil are tried.
    """
    pixels = sensor_xy(view)
    rng = np.random.default_rng([view.seed, 1])
    points = np.stack([halton(_RAYS_WHERE_SHARP, base) for base in (2, 3, 5, 7)], -1).astype(np.float32)
    aperture = lens.pupil_radius if pupil else 0.0
    for lamp in lamps:
        depth = lamp.centre[2]
        # On the plane of the lamp a ray is at where the pinhole's is, plus this share of its pupil point.
        leverage = 1 - depth / lens.focus_distance
        pitch = view.pixel_pitch / lens.sensor_distance * depth  # a pixel's side there
        blur = aperture * abs(leverage)
        seen = -pixels * np.float32(depth / lens.sensor_distance)
        offset = seen - np.array(lamp.centre[:2], np.float32)
        near = np.flatnonzero((np.abs(offset) < lamp.radius + blur + pitch).all(-1))
        if not len(near):
            continue
        count = _RAYS if blur > lamp.radius else _RAYS_WHERE_SHARP
        drawn = rotate_points(points[:count], rng.random((len(near), 1, 4), np.float32))
        place = seen[near, None] + np.float32(pitch) * (drawn[..., 2:] - np.float32(0.5))
        disc = disc_from_square(drawn[..., :2])
        if blur > lamp.radius:
            target = np.array(lamp.centre[:2], np.float32) + np.float32(lamp.radius) * disc
            origin = (target - place) / np.float32(leverage)
            weight = (origin * origin).sum(-1) <= aperture**2
            share = (lamp.radius / blur) ** 2
        else:
            origin = np.float32(aperture) * disc
            target = place + np.float32(leverage) * origin
            weight = ((target - np.array(lamp.centre[:2])) ** 2).sum(-1) <= lamp.radius**2
            share = 1.0
        rows, columns = np.nonzero(weight)
        start, end = origin[rows, columns], target[rows, columns]
        found = scene.meet(start, (end - start) / np.float32(depth))
        clear = np.zeros(weight.shape)
        clear[rows, columns] = found["tfar"] > depth * (1 - 1e-3)
        picture.reshape(-1, 3)[near] += (share * clear.mean(1))[:, None] * lamp.radiance

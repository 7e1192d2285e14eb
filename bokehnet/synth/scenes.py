"""Random scenes of planes at all depths and tilts in front of a distant background.

Lengths are in millimetres; sizes in the picture are slopes (lateral extent over depth). A relative disparity
of 1 is at ``config.nearest_distance``, the minimum depth.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.raytrace.scene import Background, Plane, Scene, background_from, plane_texture
from bokehnet.raytrace.surfaces.shapes import OPEN_SHAPES, SOLID_SHAPES, THIN_SHAPES, draw_shape
from bokehnet.raytrace.surfaces.textures import light_points
from bokehnet.synth.config import SynthConfig
from bokehnet.synth.surface_textures import surface_texture

__all__ = ["random_scene"]

_MAX_TEXTURE_SIDE = 512
_LAMP_RADIUS = (1.2, 3.0)
_LAMP_PEAK = (5.0, 100.0)


def random_scene(rng: np.random.Generator, config: SynthConfig) -> Scene:
    """Draw a scene for a camera with the sensor of ``config``.

    Args:
        rng: Random generator.
        config: Sensor, scale and probabilities.

    Returns:
        Scene on the CPU; all its points are at least at ``config.nearest_distance``.
    """
    return _SceneMaker(rng, config).make()


@dataclass(frozen=True, slots=True)
class _SceneMaker:
    """Steps of :func:`random_scene` with their shared state."""

    rng: np.random.Generator
    config: SynthConfig

    def make(self) -> Scene:
        rng, recipe = self.rng, self.config.scene
        far = 0.0 if rng.random() < recipe.sky_probability else rng.uniform(0.0, 0.3)
        background = self.background(far)
        planes = [self.plane(disparity) for disparity in self.disparities(far)]
        if rng.random() < recipe.ground_probability:
            planes.append(self.ground(far))
        if rng.random() < recipe.light_probability:
            planes.append(self.lights(far))
        return _expose(Scene(background=background, planes=tuple(planes)), rng, recipe.exposure_stops)

    def disparities(self, far: float) -> list[float]:
        """Draw relative disparities of the planes; often one is much nearer than the others."""
        rng = self.rng
        count = int(rng.integers(self.config.scene.planes[0], self.config.scene.planes[1] + 1))
        nearest = rng.uniform(0.7, 1.0) if rng.random() < 0.7 else rng.uniform(far, 1.0)
        values = [*rng.uniform(far, rng.uniform(far, 1.0), max(count - 1, 0)), nearest][:count]
        return [float(max(value, 0.02)) for value in values]

    def background(self, far: float) -> Background:
        config, rng = self.config, self.rng
        half_width = config.sensor_width / 2 / config.sensor_distance
        half = (
            half_width * rng.uniform(1.0, 1.3),
            half_width * config.height / config.width * rng.uniform(1.0, 1.3),
        )
        rgb = self.surface_texture(*self.texture_size(*half), photograph=0.85)
        return background_from(rgb, half, far / config.nearest_distance)

    def plane(self, disparity: float) -> Plane:
        """Draw a plane of random shape, size, position and tilt."""
        config, rng = self.config, self.rng
        field = config.sensor_width / 2 / config.sensor_distance
        thin = rng.random() < config.scene.thin_probability
        size = field * np.exp(rng.uniform(np.log(0.4 if thin else 0.18), np.log(1.1 if thin else 0.9)))
        stretch = np.exp(rng.uniform(np.log(0.6), np.log(1.7)))
        half = (size * stretch**0.5, size / stretch**0.5)
        reach = np.array([1.0, config.height / config.width]) * field
        middle = rng.uniform(-1.0, 1.0, 2) * reach
        height, width = self.texture_size(*half)
        kinds = THIN_SHAPES if thin else SOLID_SHAPES if rng.random() < 0.6 else OPEN_SHAPES
        texture = plane_texture(self.surface_texture(height, width), draw_shape(kinds, height, width, rng))
        depth = config.nearest_distance / disparity
        rotation = self.rotation(0.3 if thin else np.pi)
        centre = np.array([*middle, 1.0]) * depth
        u, v = rotation[:, 0] * half[0] * depth, rotation[:, 1] * half[1] * depth
        # A tilted corner may be too near: moving and enlarging the plane keeps its image.
        nearest = depth - abs(u[2]) - abs(v[2])
        if nearest < 0.2 * depth:
            u, v = u * 0.8 / (1 - nearest / depth), v * 0.8 / (1 - nearest / depth)
            nearest = 0.2 * depth
        scale = max(1.0, config.nearest_distance / nearest)
        return Plane(
            texture=texture,
            centre=_vector(centre * scale),
            u_axis=_vector(u * scale),
            v_axis=_vector(v * scale),
        )

    def ground(self, far: float) -> Plane:
        """Draw a floor, ceiling or wall that recedes from near to the background."""
        config, rng = self.config, self.rng
        field = config.sensor_width / 2 / config.sensor_distance
        near = config.nearest_distance / rng.uniform(0.5, 1.0)
        distant = near * rng.uniform(2.0, 6.0)
        if far > 0:
            distant = min(distant, max(1.2 * near, config.nearest_distance / far))
        below = near * field * rng.uniform(0.7, 1.2)
        side = distant * field * 1.6
        texture = plane_texture(self.surface_texture(384, 384))
        # Texture rows recede from the camera; then the plane is rolled about the optical axis.
        roll = rng.normal(0, 0.12) + rng.choice([0, 0, 0, np.pi / 2, -np.pi / 2, np.pi])
        rotation = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
        rise = below * rng.uniform(-0.3, 0.3)
        centre = rotation @ np.array([0.0, below + rise, (near + distant) / 2])
        u, v = rotation @ np.array([side, 0, 0]), rotation @ np.array([0, rise, (distant - near) / 2])
        return Plane(texture=texture, centre=_vector(centre), u_axis=_vector(u), v_axis=_vector(v))

    def lights(self, far: float) -> Plane:
        """Draw small distant lamps on a transparent plane across the picture."""
        config, rng = self.config, self.rng
        half_width = 1.3 * config.sensor_width / 2 / config.sensor_distance
        half = half_width, half_width * config.height / config.width
        depth = config.nearest_distance / max(far * rng.uniform(1.0, 1.5) + 0.01, rng.uniform(0.02, 0.3))
        texture = plane_texture(*light_points(*self.texture_size(*half), rng, _LAMP_RADIUS, _LAMP_PEAK))
        return Plane(
            texture=texture,
            centre=(0.0, 0.0, depth),
            u_axis=(half[0] * depth, 0.0, 0.0),
            v_axis=(0.0, half[1] * depth, 0.0),
        )

    def rotation(self, roll_limit: float) -> np.ndarray:
        """Draw a roll about the optical axis, then for half of the planes a tilt about a lateral axis."""
        rng = self.rng
        roll = rng.uniform(-roll_limit, roll_limit)
        tilt = np.radians(rng.uniform(0, self.config.scene.tilt_limit)) if rng.random() < 0.5 else 0.0
        azimuth = rng.uniform(0, 2 * np.pi)
        axis = np.array([np.cos(azimuth), np.sin(azimuth), 0])
        cross = np.array([[0, 0, axis[1]], [0, 0, -axis[0]], [-axis[1], axis[0], 0]])
        tilt_matrix = np.eye(3) + np.sin(tilt) * cross + (1 - np.cos(tilt)) * cross @ cross
        cosine, sine = np.cos(roll), np.sin(roll)
        rotation: np.ndarray = tilt_matrix @ np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
        return rotation

    def texture_size(self, half_width: float, half_height: float) -> tuple[int, int]:
        """Return rows and columns for about one texel per pixel, for half extents as slopes."""
        density = self.config.sensor_distance / self.config.pixel_pitch
        height, width = (
            int(np.clip(2 * h * density, 8, _MAX_TEXTURE_SIDE)) for h in (half_height, half_width)
        )
        return height, width

    def surface_texture(self, height: int, width: int, photograph: float = 0.65) -> np.ndarray:
        """Draw colours (H, W, 3) of similar brightness; a photograph with probability ``photograph``."""
        return surface_texture(self.config.scene, height, width, self.rng, photograph)


def _expose(scene: Scene, rng: np.random.Generator, stops: tuple[float, float]) -> Scene:
    """Scale all light by a random exposure."""
    gain = 2 ** rng.uniform(*stops)
    colours = [gain * scene.background.texture, *(plane.texture * 1.0 for plane in scene.planes)]
    for texture in colours[1:]:
        texture[:3] *= gain
    background = Background(
        texture=colours[0], half_extent=scene.background.half_extent, disparity=scene.background.disparity
    )
    planes = tuple(
        Plane(texture=texture, centre=plane.centre, u_axis=plane.u_axis, v_axis=plane.v_axis)
        for texture, plane in zip(colours[1:], scene.planes, strict=True)
    )
    return Scene(background=background, planes=planes)


def _vector(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z

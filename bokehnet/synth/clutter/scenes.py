"""Random scenes with objects on the ground: tables, rooms and open land.

A world has the ground at y = 0 and the camera one metre above its origin; results are in camera space, mm.
"""

from dataclasses import dataclass, field

import numpy as np

from bokehnet.raytrace.surfaces.textures import fractal_colours, fractal_noise, random_colour
from bokehnet.synth.clutter.baked_lighting import KeyLight, Lighting, bake, lighting_grid
from bokehnet.synth.clutter.baked_scene import BakedScene, make_soup, pack
from bokehnet.synth.clutter.grid_mesh import GridMesh, moved
from bokehnet.synth.clutter.lamps import Lamp, lamp_body
from bokehnet.synth.clutter.objects import FOREGROUND, SOLID, THIN, rotation_about
from bokehnet.synth.config import SynthConfig
from bokehnet.synth.surface_textures import surface_texture

__all__ = ["Clutter", "random_clutter"]

Point = tuple[float, float]
# Minimum and maximum corner of a box for lamps; None means sunlight.
Box = tuple[tuple[float, float, float], tuple[float, float, float]] | None

_MM_PER_M = 1000.0
# Minimum depth of triangles, mm; the ground there is far below the picture.
_MIN_DEPTH_MM = 150.0
_TEXTURE_SIDE, _GROUND_TEXTURE_SIDE = 192, 512
# Spacing of the lighting grid in pixels, and its maximum number of points along a side.
_LIGHTING_SPACING_PX, _MAX_LIGHTING_POINTS = 3.0, 128


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Clutter:
    """Scene ready for rendering.

    Attributes:
        scene: Scene without small lamps.
        lamps: Small lamps, mm.
    """

    scene: BakedScene
    lamps: tuple[Lamp, ...]


def random_clutter(rng: np.random.Generator, config: SynthConfig) -> Clutter:
    """Draw a scene for a camera with the sensor of ``config``.

    Args:
        rng: Random generator.
        config: Sensor and probabilities; ``nearest_distance`` does not set the scale of the scene.

    Raises:
        MissingExtraError: Embree or scikit-image is not installed.
    """
    return _Maker(rng, config).make()


@dataclass(slots=True)
class _Maker:
    """Steps of :func:`random_clutter` with their shared state."""

    rng: np.random.Generator
    config: SynthConfig
    meshes: list[GridMesh] = field(default_factory=list)
    textures: list[np.ndarray] = field(default_factory=list)
    pitch: float = 0.0
    farthest: float = 0.0
    waves: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))

    @property
    def reach(self) -> np.ndarray:
        """Half width and half height of the picture as slopes."""
        half = self.config.sensor_width / 2 / self.config.sensor_distance
        return np.array([half, half * self.config.height / self.config.width])

    def make(self) -> Clutter:
        rng, recipe = self.rng, self.config.clutter
        for _ in range(rng.integers(4, 9)):
            self.add_texture(self.surface())
        kind = ("table", "room", "land")[rng.choice(3, p=_normalized(recipe.places))]
        lamp_box = {"table": self.table, "room": self.room, "land": self.land}[kind]()
        for _ in range(rng.integers(recipe.objects[0], recipe.objects[1] + 1)):
            self.add_object()
        rotation = rotation_about(2, rng.normal(0, 0.03)) @ rotation_about(0, self.pitch)
        self.meshes = moved(self.meshes, _MM_PER_M * rotation, _MM_PER_M * rotation @ [0, 1, 0])
        if rng.random() < recipe.foreground_probability:
            for _ in range(rng.integers(1, 3)):
                self.add_foreground()
        lighting = self.lighting(rotation, lamp_box)
        lamps = self.lamps() if rng.random() < recipe.lamp_probability else ()
        if lamps:
            black = self.add_texture(np.zeros((1, 1, 3), np.float32))
            self.meshes += [lamp_body(lamp, black) for lamp in lamps]
        return Clutter(scene=self.finish(lighting), lamps=lamps)

    def finish(self, lighting: Lighting) -> BakedScene:
        soup = make_soup(self.meshes, _MIN_DEPTH_MM)
        pixel = self.config.pixel_pitch / self.config.sensor_distance
        grids = [
            lighting_grid(mesh, _LIGHTING_SPACING_PX * pixel, _MAX_LIGHTING_POINTS) for mesh in self.meshes
        ]
        half = self.reach * self.rng.uniform(1.0, 1.3)
        sky = self.sky() * np.float32(lighting.above.mean() * self.rng.uniform(0.7, 2.0))
        return BakedScene(
            soup=soup,
            albedo=pack(self.textures),
            light=pack(bake(grids, lighting, soup.tree, self.rng)),
            texture=np.array([mesh.texture for mesh in self.meshes], np.int64),
            sky=np.ascontiguousarray(sky, np.float32),
            sky_half=(float(half[0]), float(half[1])),
        )

    def add_texture(self, colours: np.ndarray) -> int:
        """Store a texture (h, w, 3) of colours in [0, 1]; return its index."""
        self.textures.append(np.clip(colours, 0, 0.95).astype(np.float32))
        return len(self.textures) - 1

    def draw(self) -> int:
        """Return the index of a random texture."""
        return int(self.rng.integers(len(self.textures)))

    def surface(self) -> np.ndarray:
        """Return the colours of an object: textured, or plain with slight grain."""
        rng = self.rng
        if rng.random() < 0.55:
            return surface_texture(self.config.scene, _TEXTURE_SIDE, _TEXTURE_SIDE, rng, 0.6)
        grain = fractal_noise(64, 64, rng, rng.uniform(0.7, 1.6))[..., None] - 0.5
        plain: np.ndarray = random_colour(rng) * (1 + rng.uniform(0.05, 0.6) * grain)
        return plain

    def sky(self) -> np.ndarray:
        """Return the radiance at infinity, (h, w, 3), of mean 1."""
        rng = self.rng
        if rng.random() < 0.6:
            colours = surface_texture(self.config.scene, 384, 384, rng, 0.9)
        else:
            height = np.linspace(0, 1, 256)[:, None, None]
            low, high = random_colour(rng), random_colour(rng)
            colours = low * height + high * (1 - height) + 0.2 * fractal_colours(256, 256, rng)
        return colours / max(float(colours.mean()), 1e-3)

    def ground_texture(self) -> int:
        return self.add_texture(
            surface_texture(self.config.scene, _GROUND_TEXTURE_SIDE, _GROUND_TEXTURE_SIDE, self.rng, 0.55)
        )

    def strip(
        self, texture: int, ends: tuple[Point, Point], depth: float, tile: float, fan: float = 0.0
    ) -> None:
        """Add a surface between two ``ends`` (x, y) along z up to ``depth``, with a repeated texture.

        Its width grows by the factor ``fan`` per unit of depth.
        """
        (x0, y0), (x1, y1) = ends
        z, fraction = np.meshgrid(np.geomspace(0.05, depth, 48), np.linspace(0, 1, 33), indexing="ij")
        x, y = (x0 + fraction * (x1 - x0)) * (1 + fan * z), y0 + fraction * (y1 - y0)
        if y0 == y1 == 0:
            y = y + self.height_of(x, z)
        across = x if y0 == y1 else y
        uv = np.stack([z, across], -1) / tile
        self.meshes.append(GridMesh(points=np.stack([x, y, z], -1), uv=uv, texture=texture, open=True))

    def height_of(self, x: np.ndarray | float, z: np.ndarray | float) -> np.ndarray:
        """Return the height y of the ground."""
        total = np.zeros(np.broadcast(x, z).shape)
        for size, a, b, phase in self.waves:
            total += size * np.clip(np.asarray(z) - 0.8, 0, 2) * np.sin(a * x + b * z + phase)
        return total

    def table(self) -> Box:
        """Add a table top from above, in front of a wall or a distant background; return the lamp box."""
        rng = self.rng
        self.pitch = np.radians(rng.uniform(10, 42))
        end, half = rng.uniform(1.5, 5.0), rng.uniform(0.8, 4.0)
        tile = rng.uniform(0.8, 3.0)
        self.strip(self.ground_texture(), ((-half, 0.0), (half, 0.0)), end, tile)
        self.farthest = end
        if rng.random() < 0.7:
            self.wall(end * rng.uniform(1.0, 2.5), rng.normal(0, 0.25))
        return ((-3.0, -4.0, -1.0), (3.0, -1.5, 0.8 * end)) if rng.random() < 0.7 else None

    def room(self) -> Box:
        """Add a floor, walls and perhaps a ceiling; return the lamp box."""
        rng = self.rng
        self.pitch = np.radians(rng.uniform(-2, 16))
        self.farthest = end = float(np.exp(rng.uniform(np.log(4), np.log(16))))
        left, right, height = -rng.uniform(0.8, 4), rng.uniform(0.8, 4), rng.uniform(1.6, 3.5)
        floor, walls, tile = self.ground_texture(), self.ground_texture(), rng.uniform(0.8, 3.0)
        self.strip(floor, ((left, 0.0), (right, 0.0)), end, tile)
        for x in (left, right):
            if rng.random() < 0.85:
                self.strip(walls, ((x, -height), (x, 1e-3)), end, tile)
        if rng.random() < 0.5:
            self.strip(self.draw(), ((left, -height), (right, -height)), end, tile)
        if rng.random() < 0.85:
            self.wall(end, 0.0)
        return (left + 0.3, -height + 0.1, 0.5), (right - 0.3, -1.1, 0.8 * end)

    def land(self) -> Box:
        """Add uneven ground to the horizon under a sky."""
        rng = self.rng
        self.pitch = np.radians(rng.uniform(0, 22))
        self.farthest = 40.0
        size = rng.uniform(0, 0.12, 3)
        self.waves = np.stack([size, *rng.normal(0, 1.2, (2, 3)), rng.uniform(0, 7, 3)], -1)
        tile = rng.uniform(1.0, 4.0)
        self.strip(self.ground_texture(), ((-0.8, 0.0), (0.8, 0.0)), self.farthest, tile, fan=0.8)
        return None

    def wall(self, z: float, yaw: float) -> None:
        """Add a wall across the view."""
        tile = self.rng.uniform(1.0, 4.0)
        u, v = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9))
        half = 1.0 + 1.2 * z
        points = np.stack([half * u, half * v, z + half * u * np.sin(yaw)], -1)
        uv = np.stack([half * (v + 1), half * (u + 1)], -1) / tile
        self.meshes.append(GridMesh(points=points, uv=uv, texture=self.ground_texture(), open=True))

    def add_object(self) -> None:
        """Add an object on the ground, at a uniformly random disparity."""
        rng, angle = self.rng, np.arctan(self.reach[1])
        nearest = 1 / np.tan(self.pitch + 0.9 * angle)
        farthest = min(self.farthest, 12.0, 1 / np.tan(max(self.pitch - 0.9 * angle, 0.05)))
        z = float(1 / rng.uniform(1 / max(farthest, 1.05 * nearest), 1 / nearest))
        depth = np.sin(self.pitch) + np.cos(self.pitch) * z
        x = rng.uniform(-1, 1) * self.reach[0] * depth
        thin = rng.random() < self.config.clutter.thin_probability
        size = depth * self.reach[1] * np.exp(rng.uniform(np.log(0.25), np.log(1.2 if thin else 0.9)))
        kinds = THIN if thin else SOLID
        meshes_of_kind = kinds[rng.integers(len(kinds))](rng, self.draw)
        position = (x, float(self.height_of(x, z)), z)
        # Drops meshes close to the camera: nothing behind the lens may appear in front of it.
        limit = 0.55 * nearest
        meshes = moved(meshes_of_kind, size * np.eye(3), position)
        self.meshes += [mesh for mesh in meshes if mesh.points[..., 2].min() > limit]

    def add_foreground(self) -> None:
        """Add a near object that enters the picture from the border, in camera space."""
        rng = self.rng
        angle = np.arctan(self.reach[1])
        ground = np.sin(self.pitch) + np.cos(self.pitch) / np.tan(self.pitch + angle)
        depth = _MM_PER_M * ground * rng.uniform(0.4, 0.8)
        side = rng.uniform(0, 2 * np.pi)
        outwards = np.array([np.cos(side), np.sin(side)])
        root = depth * self.reach * np.clip(1.5 * outwards, -1, 1) * rng.uniform(1.0, 1.2)
        upright = rotation_about(2, np.arctan2(-outwards[0], outwards[1]) + rng.normal(0, 0.3))
        size = depth * self.reach.min() * rng.uniform(0.5, 1.3)
        meshes_of_kind = FOREGROUND[rng.integers(len(FOREGROUND))](rng, self.draw)
        meshes = moved(meshes_of_kind, size * upright, (*root, depth))
        self.meshes += [mesh for mesh in meshes if mesh.points[..., 2].min() > 0.5 * depth]

    def lighting(self, rotation: np.ndarray, lamp_box: Box) -> Lighting:
        """Draw the sun, or up to three lamps in ``lamp_box``, and uniform light from above."""
        rng = self.rng
        keys = []
        for _ in range(1 if lamp_box is None else rng.integers(1, 4)):
            if lamp_box is not None:
                position, radius = rng.uniform(*lamp_box), rng.uniform(0.05, 0.4)
            else:
                azimuth, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.4)
                position = 1e3 * np.array([np.cos(azimuth), -np.tan(height), np.sin(azimuth)])
                radius = float(np.linalg.norm(position)) * rng.uniform(0.004, 0.06)
            camera_position = _MM_PER_M * (rotation @ (position - [0, -1, 0]))
            middle = np.array([0, 0, 2.0 * _MM_PER_M])
            tint = np.exp(rng.normal(0, 0.2, 3))
            keys.append(
                KeyLight(
                    position=camera_position,
                    radius=_MM_PER_M * radius,
                    light=tint * rng.uniform(0.3, 1.2),
                    distance=max(float(np.linalg.norm(camera_position - middle)), _MM_PER_M),
                )
            )
        above = np.exp(rng.normal(0, 0.15, 3)) * np.exp(rng.uniform(np.log(0.12), np.log(0.8)))
        total = above + sum(key.light for key in keys)
        return Lighting(
            keys=tuple(keys),
            above=above,
            bounced=rng.uniform(0.1, 0.3) * total,
            up=rotation @ [0.0, -1.0, 0.0],
        )

    def lamps(self) -> tuple[Lamp, ...]:
        """Draw small lamps anywhere in the picture except near the camera."""
        rng = self.rng
        bright = np.exp(rng.uniform(np.log(5), np.log(80)))
        tint = np.exp(rng.normal(0, 0.3, 3))
        pixel = self.config.pixel_pitch / self.config.sensor_distance
        depths = _MM_PER_M / rng.uniform(0.05, 0.6) * np.exp(rng.normal(0, 0.4, rng.integers(3, 30)))
        lamps = []
        for depth in depths:
            position = rng.uniform(-1.1, 1.1, 2) * self.reach * depth
            radiance = bright * tint * np.exp(rng.normal(0, 0.3, 3))
            radius = pixel * depth * rng.uniform(0.7, 2.5)
            lamps.append(Lamp(centre=(*position, depth), radius=radius, radiance=radiance))
        return tuple(lamps)


def _normalized(weights: tuple[float, ...]) -> np.ndarray:
    return np.array(weights) / sum(weights)

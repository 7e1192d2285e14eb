"""Random scenes with objects on the ground: tables, rooms and open land, before a camera that looks at them.

A world has the ground in y = 0 and the camera one metre above its origin; what comes out is in the space of
the camera, in mm.
"""

from dataclasses import dataclass, field

import numpy as np

from bokehnet.raytrace.surfaces.textures import fractal_colours, fractal_noise, random_colour
from bokehnet.synth.clutter.baked_lighting import KeyLight, Lighting, bake, place_grid
from bokehnet.synth.clutter.baked_scene import BakedScene, make_soup, pack
from bokehnet.synth.clutter.grid_mesh import GridMesh, moved
from bokehnet.synth.clutter.lamps import Lamp, lamp_body
from bokehnet.synth.clutter.objects import FOREGROUND, SOLID, THIN, turn_about
from bokehnet.synth.config import SynthConfig
from bokehnet.synth.surface_textures import surface_texture

__all__ = ["Clutter", "random_clutter"]

Point = tuple[float, float]
# Lowest and highest corner of a box, for lamps; None is under the sun.
Box = tuple[tuple[float, float, float], tuple[float, float, float]] | None

_MM = 1000.0
# Nothing nearer than this is drawn; the ground there is far below the picture.
_NEAREST = 150.0
_TEXTURE, _GROUND_TEXTURE = 192, 512
# Lights on surfaces are known every so many pixels, at most so often along a side.
_LIGHT_PIXELS, _LIGHT_MOST = 3.0, 128


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Clutter:
    """A scene ready to be rendered.

    Attributes:
        scene: Everything but small lamps.
        lamps: Those, mm.
    """

    scene: BakedScene
    lamps: tuple[Lamp, ...]


def random_clutter(rng: np.random.Generator, config: SynthConfig) -> Clutter:
    """Draw a scene for a camera with the sensor of ``config``.

    Args:
        rng: All choices come from here.
        config: Sensor and probabilities; the scale of the scene is not that of ``nearest_distance``.

    Raises:
        MissingExtraError: Embree or scikit-image is not installed.
    """
    return _Maker(rng, config).make()


@dataclass(slots=True)
class _Maker:
    """The rules of :func:`random_clutter`, with what they share."""

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
        place = ("table", "room", "land")[rng.choice(3, p=_shares(recipe.places))]
        lit = {"table": self.table, "room": self.room, "land": self.land}[place]()
        for _ in range(rng.integers(recipe.objects[0], recipe.objects[1] + 1)):
            self.put_thing()
        turn = turn_about(2, rng.normal(0, 0.03)) @ turn_about(0, self.pitch)
        self.meshes = moved(self.meshes, _MM * turn, _MM * turn @ [0, 1, 0])
        if rng.random() < recipe.foreground_probability:
            for _ in range(rng.integers(1, 3)):
                self.put_foreground()
        lighting = self.lighting(turn, lit)
        lamps = self.lamps() if rng.random() < recipe.lamp_probability else ()
        if lamps:
            black = self.add_texture(np.zeros((1, 1, 3), np.float32))
            self.meshes += [lamp_body(lamp, black) for lamp in lamps]
        return Clutter(scene=self.finish(lighting), lamps=lamps)

    def finish(self, lighting: Lighting) -> BakedScene:
        soup = make_soup(self.meshes, _NEAREST)
        pixel = self.config.pixel_pitch / self.config.sensor_distance
        grids = [place_grid(mesh, _LIGHT_PIXELS * pixel, _LIGHT_MOST) for mesh in self.meshes]
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
        """Keep a texture (h, w, 3) of colours in [0, 1]; return its number."""
        self.textures.append(np.clip(colours, 0, 0.95).astype(np.float32))
        return len(self.textures) - 1

    def draw(self) -> int:
        """Number of one of the textures that objects may wear."""
        return int(self.rng.integers(len(self.textures)))

    def surface(self) -> np.ndarray:
        """Colours of a thing: painted, or plain with a little grain."""
        rng = self.rng
        if rng.random() < 0.55:
            return surface_texture(self.config.scene, _TEXTURE, _TEXTURE, rng, 0.6)
        grain = fractal_noise(64, 64, rng, rng.uniform(0.7, 1.6))[..., None] - 0.5
        plain: np.ndarray = random_colour(rng) * (1 + rng.uniform(0.05, 0.6) * grain)
        return plain

    def sky(self) -> np.ndarray:
        """What is infinitely far, (h, w, 3), of mean 1."""
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
            surface_texture(self.config.scene, _GROUND_TEXTURE, _GROUND_TEXTURE, self.rng, 0.55)
        )

    def strip(
        self, texture: int, ends: tuple[Point, Point], depth: float, tile: float, fan: float = 0.0
    ) -> None:
        """A surface between two ``ends`` (x, y) that runs along z up to ``depth``; its texture repeats.

        With a ``fan`` it is that much wider for each unit of depth.
        """
        (x0, y0), (x1, y1) = ends
        z, share = np.meshgrid(np.geomspace(0.05, depth, 48), np.linspace(0, 1, 33), indexing="ij")
        x, y = (x0 + share * (x1 - x0)) * (1 + fan * z), y0 + share * (y1 - y0)
        if y0 == y1 == 0:
            y = y + self.height_of(x, z)
        across = x if y0 == y1 else y
        uv = np.stack([z, across], -1) / tile
        self.meshes.append(GridMesh(points=np.stack([x, y, z], -1), uv=uv, texture=texture, open=True))

    def height_of(self, x: np.ndarray | float, z: np.ndarray | float) -> np.ndarray:
        """Height y of the ground."""
        total = np.zeros(np.broadcast(x, z).shape)
        for size, a, b, phase in self.waves:
            total += size * np.clip(np.asarray(z) - 0.8, 0, 2) * np.sin(a * x + b * z + phase)
        return total

    def table(self) -> Box:
        """A table top, seen from above, before a wall or something far away."""
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
        """Floor, walls and perhaps a ceiling."""
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
        """Uneven ground that runs to the horizon under a sky."""
        rng = self.rng
        self.pitch = np.radians(rng.uniform(0, 22))
        self.farthest = 40.0
        size = rng.uniform(0, 0.12, 3)
        self.waves = np.stack([size, *rng.normal(0, 1.2, (2, 3)), rng.uniform(0, 7, 3)], -1)
        tile = rng.uniform(1.0, 4.0)
        self.strip(self.ground_texture(), ((-0.8, 0.0), (0.8, 0.0)), self.farthest, tile, fan=0.8)
        return None

    def wall(self, z: float, turn: float) -> None:
        """A wall across the view."""
        tile = self.rng.uniform(1.0, 4.0)
        u, v = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9))
        half = 1.0 + 1.2 * z
        points = np.stack([half * u, half * v, z + half * u * np.sin(turn)], -1)
        uv = np.stack([half * (v + 1), half * (u + 1)], -1) / tile
        self.meshes.append(GridMesh(points=points, uv=uv, texture=self.ground_texture(), open=True))

    def put_thing(self) -> None:
        """Put something on the ground, at any disparity alike."""
        rng, angle = self.rng, np.arctan(self.reach[1])
        nearest = 1 / np.tan(self.pitch + 0.9 * angle)
        farthest = min(self.farthest, 12.0, 1 / np.tan(max(self.pitch - 0.9 * angle, 0.05)))
        z = float(1 / rng.uniform(1 / max(farthest, 1.05 * nearest), 1 / nearest))
        depth = np.sin(self.pitch) + np.cos(self.pitch) * z
        x = rng.uniform(-1, 1) * self.reach[0] * depth
        thin = rng.random() < self.config.clutter.thin_probability
        size = depth * self.reach[1] * np.exp(rng.uniform(np.log(0.25), np.log(1.2 if thin else 0.9)))
        kinds = THIN if thin else SOLID
        thing = kinds[rng.integers(len(kinds))](rng, self.draw)
        place = (x, float(self.height_of(x, z)), z)
        # Things keep clear of the camera: what is behind the lens cannot be in front of it.
        limit = 0.55 * nearest
        meshes = moved(thing, size * np.eye(3), place)
        self.meshes += [mesh for mesh in meshes if mesh.points[..., 2].min() > limit]

    def put_foreground(self) -> None:
        """Something near that comes in over the border of the picture, in the space of the camera."""
        rng = self.rng
        angle = np.arctan(self.reach[1])
        ground = np.sin(self.pitch) + np.cos(self.pitch) / np.tan(self.pitch + angle)
        depth = _MM * ground * rng.uniform(0.4, 0.8)
        side = rng.uniform(0, 2 * np.pi)
        outwards = np.array([np.cos(side), np.sin(side)])
        root = depth * self.reach * np.clip(1.5 * outwards, -1, 1) * rng.uniform(1.0, 1.2)
        upright = turn_about(2, np.arctan2(-outwards[0], outwards[1]) + rng.normal(0, 0.3))
        size = depth * self.reach.min() * rng.uniform(0.5, 1.3)
        thing = FOREGROUND[rng.integers(len(FOREGROUND))](rng, self.draw)
        meshes = moved(thing, size * upright, (*root, depth))
        self.meshes += [mesh for mesh in meshes if mesh.points[..., 2].min() > 0.5 * depth]

    def lighting(self, turn: np.ndarray, lit: Box) -> Lighting:
        """The sun, or up to three lamps somewhere in the box ``lit``, and even light from above."""
        rng = self.rng
        keys = []
        for _ in range(1 if lit is None else rng.integers(1, 4)):
            if lit is not None:
                spot, radius = rng.uniform(*lit), rng.uniform(0.05, 0.4)
            else:
                around, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.4)
                spot = 1e3 * np.array([np.cos(around), -np.tan(height), np.sin(around)])
                radius = float(np.linalg.norm(spot)) * rng.uniform(0.004, 0.06)
            away = _MM * (turn @ (spot - [0, -1, 0]))
            middle = np.array([0, 0, 2.0 * _MM])
            tint = np.exp(rng.normal(0, 0.2, 3))
            keys.append(
                KeyLight(
                    position=away,
                    radius=_MM * radius,
                    light=tint * rng.uniform(0.3, 1.2),
                    distance=max(float(np.linalg.norm(away - middle)), _MM),
                )
            )
        above = np.exp(rng.normal(0, 0.15, 3)) * np.exp(rng.uniform(np.log(0.12), np.log(0.8)))
        total = above + sum(key.light for key in keys)
        return Lighting(
            keys=tuple(keys), above=above, bounced=rng.uniform(0.1, 0.3) * total, up=turn @ [0.0, -1.0, 0.0]
        )

    def lamps(self) -> tuple[Lamp, ...]:
        """Small lamps, anywhere in the picture but near."""
        rng = self.rng
        bright = np.exp(rng.uniform(np.log(5), np.log(80)))
        tint = np.exp(rng.normal(0, 0.3, 3))
        pixel = self.config.pixel_pitch / self.config.sensor_distance
        depths = _MM / rng.uniform(0.05, 0.6) * np.exp(rng.normal(0, 0.4, rng.integers(3, 30)))
        found = []
        for depth in depths:
            place = rng.uniform(-1.1, 1.1, 2) * self.reach * depth
            radiance = bright * tint * np.exp(rng.normal(0, 0.3, 3))
            radius = pixel * depth * rng.uniform(0.7, 2.5)
            found.append(Lamp(centre=(*place, depth), radius=radius, radiance=radiance))
        return tuple(found)


def _shares(weights: tuple[float, ...]) -> np.ndarray:
    return np.array(weights) / sum(weights)

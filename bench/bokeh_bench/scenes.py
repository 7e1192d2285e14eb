"""Scenes of the benchmark, drawn from seeds, and the cameras of their shots."""

from dataclasses import dataclass

import numpy as np

from bokeh_bench.surfaces import Card, Outline, Sphere, Surface, Texture
from bokeh_bench.tracing import Camera

__all__ = ["RECIPES", "Recipe", "Scene", "Shot", "draw"]

# Camera of all scenes: pixels, sensor width and focal length, mm.
WIDTH, HEIGHT, SENSOR_WIDTH, FOCAL_LENGTH = 320, 240, 54.0, 75.0


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """Recipe of a scene.

    Attributes:
        seed: Seed of the scene.
        kind: Arrangement, see :func:`draw`.
        focus: Distance in focus of each shot, metres.
        f_numbers: F-number of each shot.
        blades: Blades of each shot; 0 is a disc.
    """

    seed: int
    kind: str
    focus: tuple[float, float]
    f_numbers: tuple[float, float]
    blades: tuple[int, int] = (0, 6)


@dataclass(frozen=True, kw_only=True)
class Shot:
    """Exposure of a scene: f-number, focus in metres, blades."""

    f_number: float
    focus: float
    blades: int


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Surfaces, sky (2, 3) and shots."""

    name: str
    surfaces: list[Surface]
    sky: np.ndarray
    shots: list[Shot]


RECIPES = {
    "table": Recipe(seed=21, kind="table", focus=(0.9, 1.8), f_numbers=(1.2, 1.2)),
    "fence": Recipe(seed=22, kind="fence", focus=(3.0, 0.8), f_numbers=(1.4, 1.2)),
    "leaves": Recipe(seed=23, kind="leaves", focus=(2.5, 1.0), f_numbers=(1.2, 1.4)),
    "twigs": Recipe(seed=24, kind="twigs", focus=(1.2, 4.0), f_numbers=(1.2, 1.2)),
    "near": Recipe(seed=25, kind="near", focus=(4.0, 1.5), f_numbers=(1.2, 1.8)),
    "lamps": Recipe(seed=26, kind="lamps", focus=(1.2, 2.5), f_numbers=(1.2, 1.2), blades=(0, 8)),
}


def camera(shot: Shot | None = None, width: int = WIDTH, height: int = HEIGHT, shift: float = 0.0) -> Camera:
    """Return the camera of a shot, or the pinhole camera.

    The blur radius in pixels of an inverse distance in 1/m is ``f^2 / (2 N) * focus / (focus - f)``, over
    the pixel pitch.
    """
    slope = SENSOR_WIDTH / FOCAL_LENGTH / width
    if shot is None:
        return Camera(width=width, height=height, slope=slope, shift=shift)
    focal = FOCAL_LENGTH / 1000
    blur = focal**2 / (2 * shot.f_number) * shot.focus / (shot.focus - focal) * 1000 * width / SENSOR_WIDTH
    return Camera(
        width=width, height=height, slope=slope, blur=blur, focus=shot.focus, blades=shot.blades, shift=shift
    )


class _Draw:
    """Random surfaces of one scene."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        # Half extent of the view per metre of depth.
        self.half = 0.5 * SENSOR_WIDTH / FOCAL_LENGTH

    def number(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def color(self, low: float = 0.05, high: float = 0.8) -> tuple[float, float, float]:
        base, tint = self.number(low, high), self.rng.uniform(0.4, 1.0, 3)
        return tuple(float(base * part / tint.max()) for part in tint)  # type: ignore[return-value]

    def texture(self, depth: float, pattern: str | None = None) -> Texture:
        """Return a texture with waves of 6 to 60 pixels at a depth."""
        pixel = depth * 2 * self.half / WIDTH
        waves = np.empty((6, 4), np.float32)
        for wave in waves:
            angle, length = self.number(0, 2 * np.pi), pixel * 6 * 10 ** self.number(0, 1)
            wave[:2] = 2 * np.pi / length * np.cos(angle), 2 * np.pi / length * np.sin(angle)
            wave[2:] = self.number(0, 2 * np.pi), self.number(0.05, 0.22)
        kind = pattern or str(self.rng.choice(["plain", "plain", "checks", "stripes"]))
        return Texture(
            color=self.color(),
            waves=waves,
            pattern=kind,
            period=pixel * self.number(8, 30),
            second=self.color(),
        )

    def place(self, depth: float, spread: float = 0.9) -> tuple[float, float, float]:
        """Return a random position in view at a depth."""
        return (
            spread * self.half * depth * self.number(-1, 1),
            spread * self.half * depth * HEIGHT / WIDTH * self.number(-1, 1),
            depth,
        )

    def lamp(self, depth: float, pixels: float, brightness: float) -> Card:
        """Return a small bright disc of a radius in pixels."""
        tint = self.rng.uniform(0.5, 1.0, 3)
        color = tuple(float(brightness * part) for part in tint / tint.max())
        texture = Texture(color=color, waves=np.zeros((0, 4), np.float32))  # type: ignore[arg-type]
        radius = pixels * depth * 2 * self.half / WIDTH
        return Card(
            center=self.place(depth),
            texture=texture,
            outline=Outline(kind="disc", size=(radius, radius)),
            lamp=True,
        )


def _floor(draw: _Draw, height: float, slope: float) -> Card:
    """Return a floor that rises by ``slope`` per metre, ``height`` below the axis at 0.5 m."""
    return Card(center=(0, height, 0.5), texture=draw.texture(0.8, "checks"), gradient=(0, -1 / slope))


def _wall(draw: _Draw, depth: float) -> Card:
    return Card(center=(0, 0, depth), texture=draw.texture(depth), gradient=(draw.number(-0.3, 0.3), 0))


def _table(draw: _Draw) -> list[Surface]:
    surfaces: list[Surface] = [_wall(draw, 4.0), _floor(draw, 0.16, 0.12)]
    for depth in (0.65, 0.9, 1.1, 1.4, 1.9, 2.5):
        x, _, z = draw.place(depth)
        radius = draw.number(0.05, 0.12) * depth
        y = 0.16 - 0.12 * (depth - 0.5) - 0.8 * radius
        surfaces.append(Sphere(center=(x, y, z), radius=radius, texture=draw.texture(depth)))
    for depth in (0.7, 1.3):
        x, y, z = draw.place(depth)
        outline = Outline(kind="box", size=(0.006 * depth, 0.25 * depth))
        surfaces.append(
            Card(center=(x, y, z), texture=draw.texture(depth), outline=outline, angle=draw.number(-0.3, 0.3))
        )
    return surfaces


def _fence(draw: _Draw) -> list[Surface]:
    surfaces: list[Surface] = [_wall(draw, 8.0)]
    for depth in (2.4, 3.0, 4.5):
        size = draw.number(0.12, 0.2) * depth
        outline = Outline(
            kind=str(draw.rng.choice(["disc", "star", "box"])), size=(size, size), fraction=0.35
        )
        surfaces.append(Card(center=draw.place(depth, 0.7), texture=draw.texture(depth), outline=outline))
    bars = Outline(kind="fence", size=(2.0, 2.0), period=0.075, fraction=0.12)
    surfaces.append(
        Card(
            center=(0, 0, 0.8),
            texture=draw.texture(0.8, "plain"),
            outline=bars,
            angle=0.7,
            gradient=(0.25, 0),
        )
    )
    return surfaces


def _leaves(draw: _Draw) -> list[Surface]:
    surfaces: list[Surface] = []
    for depth in np.geomspace(0.7, 9.0, 26):
        z = float(depth)
        size = draw.number(0.05, 0.16) * z
        outline = Outline(
            kind=str(draw.rng.choice(["star", "disc", "ring"])),
            size=(size, size),
            fraction=draw.number(0.2, 0.6),
            teeth=int(draw.rng.integers(2, 8)),
        )
        surfaces.append(
            Card(
                center=draw.place(z, 1.0),
                texture=draw.texture(z),
                outline=outline,
                angle=draw.number(0, 6),
                gradient=(draw.number(-0.5, 0.5), draw.number(-0.5, 0.5)),
            )
        )
    return surfaces


def _twigs(draw: _Draw) -> list[Surface]:
    surfaces: list[Surface] = [_floor(draw, 0.35, 0.09)]
    for depth in np.geomspace(0.7, 6.0, 22):
        z = float(depth)
        width = draw.number(0.7, 2.5) * z * 2 * draw.half / WIDTH
        outline = Outline(kind="box", size=(width, draw.number(0.15, 0.4) * z))
        surfaces.append(
            Card(
                center=draw.place(z),
                texture=draw.texture(z, "plain"),
                outline=outline,
                angle=draw.number(-1.2, 1.2),
                gradient=(draw.number(-0.3, 0.3), draw.number(-0.3, 0.3)),
            )
        )
    return surfaces


def _near(draw: _Draw) -> list[Surface]:
    surfaces: list[Surface] = [_wall(draw, 6.0)]
    for depth in (4.0, 3.0, 2.2, 1.5):
        radius = draw.number(0.06, 0.13) * depth
        surfaces.append(Sphere(center=draw.place(depth, 0.7), radius=radius, texture=draw.texture(depth)))
    for depth in (0.62, 0.7, 0.85):
        size = draw.number(0.06, 0.12) * depth
        outline = Outline(
            kind=str(draw.rng.choice(["star", "ring", "disc"])), size=(size, size), fraction=0.4
        )
        surfaces.append(Card(center=draw.place(depth, 0.9), texture=draw.texture(depth), outline=outline))
    return surfaces


def _lamps(draw: _Draw) -> list[Surface]:
    dark = Texture(color=(0.02, 0.025, 0.04), waves=draw.texture(6.0).waves)
    surfaces: list[Surface] = [Card(center=(0, 0, 8.0), texture=dark)]
    for depth in (1.1, 1.2, 1.8, 2.5):
        radius = draw.number(0.07, 0.13) * depth
        surfaces.append(Sphere(center=draw.place(depth, 0.8), radius=radius, texture=draw.texture(depth)))
    for _ in range(18):
        surfaces.append(draw.lamp(draw.number(3.0, 7.5), draw.number(0.8, 2.0), 10 ** draw.number(0.8, 2.0)))
    for _ in range(3):
        surfaces.append(draw.lamp(draw.number(0.7, 0.9), draw.number(0.8, 1.5), 10 ** draw.number(0.8, 1.6)))
    return surfaces


_KINDS = {
    "table": _table,
    "fence": _fence,
    "leaves": _leaves,
    "twigs": _twigs,
    "near": _near,
    "lamps": _lamps,
}


def draw(name: str) -> Scene:
    """Draw a scene of ``RECIPES`` from its seed."""
    recipe = RECIPES[name]
    random = _Draw(recipe.seed)
    surfaces = _KINDS[recipe.kind](random)
    sky = np.array([[0.35, 0.55, 0.9], [0.9, 0.9, 0.85]])
    shots = [
        Shot(f_number=number, focus=focus, blades=blades)
        for number, focus, blades in zip(recipe.f_numbers, recipe.focus, recipe.blades, strict=True)
    ]
    return Scene(name=name, surfaces=surfaces, sky=sky, shots=shots)

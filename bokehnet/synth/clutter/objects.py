"""Random objects as meshes: they rest on y = 0 and are about one unit high.

Every function takes a NumPy generator and ``draw``, which returns the index of a random texture.
"""

from collections.abc import Callable

import numpy as np

from bokehnet.synth.clutter.grid_mesh import GridMesh, box, lathe, moved, plate, revolve, ribbon, tube

__all__ = ["FOREGROUND", "SOLID", "THIN", "ObjectMaker", "rotation_about"]

Draw = Callable[[], int]
ObjectMaker = Callable[[np.random.Generator, Draw], list[GridMesh]]


def rotation_about(axis: int, angle: float) -> np.ndarray:
    """Return the matrix (3, 3) of a rotation about x, y or z by ``angle``, radians."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = np.cos(angle)
    matrix[first, second], matrix[second, first] = -np.sin(angle), np.sin(angle)
    return matrix


def crate(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a box of random proportions."""
    return moved(box(rng.uniform(0.3, 1.0, 3), draw()), rotation_about(1, rng.uniform(0, 2 * np.pi)))


def pile(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a stack of slightly rotated boxes, such as books or bricks."""
    meshes: list[GridMesh] = []
    height, size = 0.0, rng.uniform(0.5, 0.9, 2)
    for _ in range(rng.integers(2, 6)):
        thick = rng.uniform(0.06, 0.25)
        book = box((size[0] * rng.uniform(0.7, 1), thick, size[1] * rng.uniform(0.7, 1)), draw(), below=True)
        meshes += moved(book, rotation_about(1, rng.normal(0, 0.35)), (0, -height, 0))
        height += thick
    return moved(meshes, rotation_about(1, rng.uniform(0, 2 * np.pi)))


def slab(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a tilted thin board: a slope."""
    length, thick, tilt = rng.uniform(0.8, 1.6), rng.uniform(0.02, 0.08), rng.uniform(0.2, 1.2)
    board = moved(box((rng.uniform(0.4, 1.2), thick, length), draw(), below=True), rotation_about(0, tilt))
    lifted = moved(board, shift=(0, -0.5 * length * np.sin(tilt), 0))
    return moved(lifted, rotation_about(1, rng.uniform(0, 2 * np.pi)))


def ball(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a sphere."""
    angle = np.linspace(0, np.pi, 20)
    profile = 0.4 * np.stack([np.sin(angle), 1 + np.cos(angle)], -1)
    return moved([revolve(profile, draw(), 32)], rotation_about(1, rng.uniform(0, 2 * np.pi)))


def rock(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a lump with dents."""
    sphere = ball(rng, draw)[0]
    points = sphere.points - [0, -0.4, 0]
    swell = np.ones(points.shape[:2])
    for _ in range(6):
        direction, wave = rng.normal(size=3), rng.uniform(3, 9)
        swell += 0.08 * np.sin(points @ direction * wave + rng.uniform(0, 2 * np.pi))
    stretched = points * swell[..., None] * rng.uniform(0.6, 1.3, 3)
    grounded = stretched + np.array([0, 0.04 - stretched[..., 1].max(), 0])
    return [GridMesh(points=grounded, uv=sphere.uv, texture=sphere.texture)]


def vase(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a solid of revolution: a cup, bottle, vase, post or cone."""
    height = np.linspace(1, 0, 18)
    waves = sum(rng.normal(0, 0.35) / k * np.cos(k * np.pi * height + rng.uniform(0, 7)) for k in (1, 2, 3))
    radius = rng.uniform(0.12, 0.4) * np.exp(np.clip(waves, -1, 1))
    return lathe(np.stack([radius, height], -1), draw(), 28)


def table(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a board on four legs, with an object on it."""
    texture, (x, z), thick = draw(), rng.uniform(0.6, 1.3, 2), 0.05
    meshes = moved(box((x, thick, z), texture, below=True), shift=(0, -0.7, 0))
    for a in (-0.45, 0.45):
        for b in (-0.45, 0.45):
            meshes += moved(box((0.06, 0.7, 0.06), texture), shift=(a * x, 0, b * z))
    meshes += moved(_random_object(SMALL, rng, draw), 0.3 * np.eye(3), (0, -0.75, 0))
    return moved(meshes, rotation_about(1, rng.uniform(0, 2 * np.pi)))


def curtain(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return hanging cloth in waves: smooth slopes."""
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, 60), np.linspace(0, 1, 8))
    depth = sum(rng.uniform(0.02, 0.09) * np.sin(k * u + rng.uniform(0, 7)) for k in (6, 11, 19))
    points = np.stack([u, v - 1, depth * (0.5 + 0.5 * v)], -1)
    uv = np.stack([v, u + 0.6], -1)
    cloth = [GridMesh(points=points, uv=uv, texture=draw(), open=True)]
    return moved(cloth, rotation_about(1, rng.normal(0, 0.6)))


def card(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return an upright or tilted sheet."""
    width, height, tilt = rng.uniform(0.4, 1.2), rng.uniform(0.5, 1.2), rng.uniform(-0.2, 1.0)
    sheet = plate((-width / 2, -height, 0), (width, 0, 0), (0, height, 0), draw(), cells=(4, 4))
    return moved(moved([sheet], rotation_about(0, -tilt)), rotation_about(1, rng.normal(0, 0.8)))


def knot(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a thick rope in a knot with holes."""
    t = np.linspace(0, 2 * np.pi, 90)
    p, q = ((2, 3), (3, 2), (1, 0), (2, 5))[rng.integers(4)]
    around = 0.25 + 0.1 * np.cos(q * t)
    path = np.stack([around * np.cos(p * t), around * np.sin(p * t), 0.1 * np.sin(q * t)], -1)
    ring = moved(
        [tube(path, np.full(90, rng.uniform(0.03, 0.08)), draw(), 10)], rotation_about(0, rng.normal())
    )
    ring = moved(ring, rotation_about(1, rng.uniform(0, 7)))
    return moved(ring, 1.4 * np.eye(3), (0, -1.4 * ring[0].points[..., 1].max(), 0))


def pole(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return one to three straight posts or wires."""
    meshes, texture = [], draw()
    for _ in range(rng.integers(1, 4)):
        foot, tilt = np.array([rng.uniform(-0.3, 0.3), 0, rng.uniform(-0.3, 0.3)]), rng.normal(0, 0.08, 2)
        path = foot + np.linspace(0, rng.uniform(0.8, 2.0), 6)[:, None] * [tilt[0], -1, tilt[1]]
        meshes.append(tube(path, np.full(6, np.exp(rng.uniform(np.log(0.004), np.log(0.04)))), texture, 8))
    return meshes


def fence(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a fence of pickets and rails, or of crossed wires."""
    texture, width, count = draw(), rng.uniform(1.5, 3.0), int(rng.integers(6, 22))
    thick = rng.uniform(0.006, 0.03)
    slant = 0.5 if rng.random() < 0.4 else 0.0
    meshes = []
    for x in np.linspace(-width / 2, width / 2, count):
        for direction in (-slant, slant) if slant else (0.0,):
            path = np.array([[x - direction / 2, 0, 0], [x, -0.4, 0], [x + direction / 2, -0.8, 0]])
            meshes.append(tube(path, np.full(3, thick), texture, 5))
    for height in rng.uniform(0.1, 0.8, rng.integers(1, 4)):
        path = np.array([[-width / 2, -height, thick], [0, -height, thick], [width / 2, -height, thick]])
        meshes.append(tube(path, np.full(3, thick), texture, 5))
    return moved(meshes, rotation_about(1, rng.normal(0, 0.7)))


def net(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a net of straight or diagonal wires, with or without posts."""
    texture, half, height = draw(), rng.uniform(0.4, 1.2), rng.uniform(0.5, 1.0)
    gap = np.exp(rng.uniform(np.log(0.03), np.log(0.15)))
    thick, slant, sag = gap * rng.uniform(0.03, 0.15), rng.random() < 0.5, rng.uniform(0, 0.06)
    t = np.linspace(0, 1, 9)

    def wire(start: np.ndarray, end: np.ndarray) -> GridMesh:
        line = start + t[:, None] * (end - start)
        bent = np.stack([line[:, 0], -line[:, 1], sag * np.sin(5 * line[:, 0] + 3 * line[:, 1])], -1)
        return tube(bent, np.full(len(t), thick), texture, 4)

    meshes = []
    if slant:
        for offset in np.arange(-half - height, half, gap):
            first, last = max(-half - offset, 0.0), min(half - offset, height)
            if last > first:
                for side in (1, -1):
                    start, end = (np.array([side * (offset + a), a]) for a in (first, last))
                    meshes.append(wire(start, end))
    else:
        meshes += [wire(np.array([x, 0]), np.array([x, height])) for x in np.arange(-half, half, gap)]
        meshes += [wire(np.array([-half, y]), np.array([half, y])) for y in np.arange(gap, height, gap)]
    if rng.random() < 0.6:
        for x in (-half, half):
            path = np.array([[x, 0, 0], [x, -height / 2, 0], [x, -1.05 * height, 0]])
            meshes.append(tube(path, np.full(3, rng.uniform(0.01, 0.04)), texture, 8))
    return moved(meshes, rotation_about(1, rng.normal(0, 0.5)))


def wheel(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a wheel of rim, hub and spokes."""
    texture, radius, count = draw(), rng.uniform(0.3, 0.5), int(rng.integers(6, 36))
    around = np.linspace(0, 2 * np.pi, 49)
    ring = np.stack([radius * np.sin(around), radius * np.cos(around) - radius, 0 * around], -1)
    meshes = [tube(ring, np.full(49, rng.uniform(0.008, 0.05)), draw(), 8)]
    thick, lead = rng.uniform(0.002, 0.012), rng.uniform(0, 0.6)
    for i, angle in enumerate(np.linspace(0, 2 * np.pi, count, endpoint=False)):
        start = angle + (lead if i % 2 else -lead)
        inner = 0.1 * radius * np.array([np.sin(start), np.cos(start)])
        outer = radius * np.array([np.sin(angle), np.cos(angle)])
        t = np.linspace(0, 1, 4)[:, None]
        path = np.concatenate([inner + t * (outer - inner) - [0, radius], 0 * t], -1)
        meshes.append(tube(path, np.full(4, thick), texture, 4))
    return moved(meshes, rotation_about(1, rng.normal(0, 0.8)))


def cables(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return cables that sag between two ends."""
    texture, half = draw(), rng.uniform(0.8, 2.0)
    t = np.linspace(-1, 1, 24)
    meshes = []
    for _ in range(rng.integers(2, 8)):
        height, fall, sag = rng.uniform(0.3, 1.6), rng.normal(0, 0.2), rng.uniform(0.02, 0.4)
        path = np.stack([half * t, -(height + fall * t + sag * (t * t - 1)), 0 * t + rng.normal(0, 0.1)], -1)
        meshes.append(tube(path, np.full(24, np.exp(rng.uniform(np.log(0.002), np.log(0.02)))), texture, 5))
    return moved(meshes, rotation_about(1, rng.normal(0, 0.5)))


def meadow(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return many blades of grass or reeds at several depths."""
    meshes, textures = [], [draw() for _ in range(2)]
    t = np.linspace(0, 1, 6)[:, None]
    spread, wide = rng.uniform(0.3, 1.2), rng.uniform(0.003, 0.02)
    for _ in range(rng.integers(60, 200)):
        foot = np.array([rng.normal(0, spread), 0, rng.normal(0, spread)])
        bend = np.array([rng.normal(0, 0.25), 0, rng.normal(0, 0.25)])
        path = foot + rng.uniform(0.3, 0.9) * (t * [0, -1, 0] + t * t * bend)
        angle = rng.uniform(0, np.pi)
        across = wide * rng.uniform(0.6, 1.4) * np.array([np.cos(angle), 0, np.sin(angle)])
        meshes.append(ribbon(path, (1 - 0.95 * t) * across, textures[rng.integers(2)]))
    return meshes


def plant(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return twigs with or without leaves."""
    meshes: list[GridMesh] = []
    bark, green = draw(), draw()
    thick, leaf, bare = rng.uniform(0.004, 0.02), rng.uniform(0.04, 0.14), rng.random() < 0.25

    def grow(start: np.ndarray, direction: np.ndarray, length: float, depth: int) -> None:
        steps = 6
        directions = direction + np.cumsum(rng.normal(0, 0.16, (steps, 3)), 0)
        path = start + np.concatenate([np.zeros((1, 3)), np.cumsum(directions * length / steps, 0)])
        meshes.append(tube(path, np.linspace(1, 0.5, steps + 1) * thick * 0.6 ** (2 - depth), bark, 4))
        for place in path[1:]:
            side = direction + rng.normal(0, 0.7, 3)
            side /= max(float(np.linalg.norm(side)), 1e-9)
            if depth and rng.random() < 0.55:
                grow(place, side, length * rng.uniform(0.35, 0.7), depth - 1)
            if not bare and depth < 2 and rng.random() < 0.75:
                meshes.append(_leaf(place, side, leaf * rng.uniform(0.6, 1.2), green, rng))

    for _ in range(rng.integers(1, 4)):
        grow(np.zeros(3), np.array([rng.normal(0, 0.3), -1, rng.normal(0, 0.3)]), rng.uniform(0.5, 1.0), 2)
    return meshes


def _leaf(
    start: np.ndarray, direction: np.ndarray, length: float, texture: int, rng: np.random.Generator
) -> GridMesh:
    t = np.linspace(0, 1, 6)[:, None]
    path = start + length * (t * direction + 0.3 * t * t * rng.normal(0, 0.5, 3))
    across = np.cross(direction, rng.normal(size=3))
    across /= max(float(np.linalg.norm(across)), 1e-9)
    return ribbon(path, length * rng.uniform(0.15, 0.3) * np.sin(np.pi * t**0.8) * across, texture)


def tuft(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a tuft of grass."""
    meshes, texture = [], draw()
    t = np.linspace(0, 1, 6)[:, None]
    for _ in range(rng.integers(15, 70)):
        foot = np.array([rng.normal(0, 0.2), 0, rng.normal(0, 0.2)])
        bend = np.array([rng.normal(0, 0.35), 0, rng.normal(0, 0.35)])
        path = foot + rng.uniform(0.4, 1.0) * (t * [0, -1, 0] + t * t * bend)
        angle = rng.uniform(0, np.pi)
        across = rng.uniform(0.006, 0.02) * np.array([np.cos(angle), 0, np.sin(angle)])
        meshes.append(ribbon(path, (1 - 0.95 * t) * across, texture))
    return meshes


def hair(rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    """Return a head with fine strands of hair."""
    meshes, texture = [], draw()
    t = np.linspace(0, 1, 8)[:, None]
    comb = np.array([rng.normal(0, 0.4), rng.uniform(-1, 0.3), rng.normal(0, 0.2)])
    for _ in range(rng.integers(40, 130)):
        out = rng.normal(size=3)
        out[1] = -abs(out[1])
        out /= max(float(np.linalg.norm(out)), 1e-9)
        start = np.array([0, -0.3, 0]) + 0.25 * out
        path = start + rng.uniform(0.3, 0.7) * (t * out + t * t * (comb + rng.normal(0, 0.25, 3)))
        meshes.append(tube(path, np.linspace(0.003, 0.0012, 8) * rng.uniform(0.6, 2), texture, 3))
    head = ball(rng, draw)
    return [*moved(head, 0.65 * np.eye(3), (0, -0.05, 0)), *meshes]


def _random_object(objects: tuple[ObjectMaker, ...], rng: np.random.Generator, draw: Draw) -> list[GridMesh]:
    return objects[rng.integers(len(objects))](rng, draw)


SMALL: tuple[ObjectMaker, ...] = (crate, pile, ball, rock, vase, knot, card)
SOLID: tuple[ObjectMaker, ...] = (*SMALL, slab, table, curtain)
THIN: tuple[ObjectMaker, ...] = (
    pole,
    fence,
    net,
    wheel,
    cables,
    plant,
    plant,
    tuft,
    meadow,
    hair,
)
FOREGROUND: tuple[ObjectMaker, ...] = (
    plant,
    plant,
    tuft,
    hair,
    pole,
    fence,
    net,
    cables,
    crate,
    ball,
    vase,
    curtain,
    card,
)

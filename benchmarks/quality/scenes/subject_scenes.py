"""Scenes with a known subject, rendered by ray casting: ground, wall, spheres, posts, cards."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.resample import resample

__all__ = ["MAPS", "Case", "blurred", "rendered_cases"]

Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

HEIGHT, WIDTH = 240, 360

# Height of the camera above the ground, m, and field of view: half the width of the picture at 1 m.
_CAMERA_HEIGHT, _HALF_WIDTH = 1.5, 0.55

# Errors of the maps of rendered scenes: standard deviation of the blur, pixels; exponent; standard deviation
# of the noise.
MAPS = {"fair maps": (1.5, 0.8, 0.002), "poor maps": (4.0, 0.6, 0.005)}


@dataclass(frozen=True)
class Case:
    """Picture with a map and the subject chosen by hand; without a subject the fallback is right."""

    name: str
    image: Array
    disparity: Array
    subject: Mask


@dataclass(frozen=True)
class Body:
    """Body of a rendered scene: kind, position, size in metres, colour.

    A sphere has its centre at (x, y, z) and the radius ``size``; a post stands on the ground with the radius
    ``size`` and the height ``y``; a card is upright at the distance z, its lower left corner at (x, y), with
    the width ``size`` and the height ``tall``.
    """

    kind: str
    x: float
    y: float
    z: float
    size: float
    color: tuple[float, float, float]
    tall: float = 0.0


RED, BLUE, SKIN, LEAF, GREY = (
    (0.6, 0.1, 0.1),
    (0.1, 0.2, 0.5),
    (0.6, 0.4, 0.3),
    (0.1, 0.35, 0.08),
    (0.4, 0.4, 0.4),
)
WOOD, WHITE, YELLOW = (0.35, 0.22, 0.1), (0.8, 0.8, 0.75), (0.7, 0.55, 0.05)


def person(x: float, z: float, color: tuple[float, float, float], tall: float = 1.7) -> list[Body]:
    """Return the body and the head of a person."""
    return [Body("post", x, tall - 0.25, z, 0.24, color), Body("sphere", x, tall - 0.13, z, 0.13, SKIN)]


def leaves(seed: int, count: int, box: tuple[float, float, float, float], z: float) -> list[Body]:
    """Return leaves in a rectangle (left, lower, right, upper) at the distance z."""
    rng = np.random.default_rng(seed)
    left, low, right, high = box
    return [
        Body(
            "sphere", rng.uniform(left, right), rng.uniform(low, high), z * rng.uniform(0.9, 1.1), 0.05, LEAF
        )
        for _ in range(count)
    ]


# Name, distance of the wall (0: open country), bodies, indices of the subject's bodies.
SCENES: list[tuple[str, float, list[Body], tuple[int, ...]]] = [
    ("person, centre", 0, person(0, 4, RED), (0, 1)),
    ("person, left third", 0, person(-0.75, 4, BLUE), (0, 1)),
    ("person, right third, wall", 9, person(0.9, 5, RED), (0, 1)),
    ("person before a house", 12, [*person(0.3, 3.5, BLUE), Body("card", -6, 0, 10, 8, WHITE, 4)], (0, 1)),
    ("person behind leaves", 0, [*person(0.2, 4, RED), *leaves(1, 60, (-0.7, 1.6, 0.1, 2.0), 1.0)], (0, 1)),
    (
        "person behind a wall's edge",
        0,
        [*person(0.4, 5, RED), Body("card", -2, 0, 1.5, 1.4, GREY, 3)],
        (0, 1),
    ),
    ("couple", 0, [*person(-0.3, 4, RED), *person(0.35, 4.1, BLUE)], (0, 1, 2, 3)),
    ("three people, one depth", 15, [b for x in (-0.9, 0, 0.9) for b in person(x, 5, BLUE)], tuple(range(6))),
    (
        "near person, far crowd",
        0,
        [*person(-0.5, 3, RED), *(b for x in (0, 1, 2, 3) for b in person(x, 12, GREY))],
        (0, 1),
    ),
    ("child before a tree", 0, [*person(0.5, 3, YELLOW, 1.2), Body("post", -1.2, 4, 6, 0.3, WOOD)], (0, 1)),
    ("ball on the lawn", 0, [Body("sphere", -0.3, 0.4, 3, 0.4, RED)], (0,)),
    (
        "ball among others",
        8,
        [
            Body("sphere", 0, 0.9, 3, 0.5, RED),
            Body("sphere", -1.6, 0.5, 5, 0.4, BLUE),
            Body("sphere", 1.9, 0.6, 6, 0.5, YELLOW),
        ],
        (0,),
    ),
    (
        "flower, close",
        0,
        [Body("sphere", 0.02, 1.5, 0.5, 0.07, YELLOW), Body("post", 0.02, 1.46, 0.5, 0.006, LEAF)],
        (0, 1),
    ),
    (
        "flower, low third",
        0,
        [Body("sphere", 0.1, 1.42, 0.6, 0.05, RED), Body("post", 0.1, 1.4, 0.6, 0.005, LEAF)],
        (0, 1),
    ),
    (
        "bird, small",
        0,
        [Body("sphere", 0.5, 1.7, 6, 0.25, WHITE), Body("post", 0.5, 1.45, 6, 0.03, WOOD)],
        (0, 1),
    ),
    ("round post in front", 10, [Body("post", -0.1, 1.9, 2, 0.22, WOOD)], (0,)),
    (
        "post beside the way",
        0,
        [
            Body("post", 0.6, 1.6, 3, 0.15, WOOD),
            Body("post", 0.8, 1.6, 7, 0.15, WOOD),
            Body("post", 0.95, 1.6, 12, 0.15, WOOD),
        ],
        (0,),
    ),
    ("car, middle distance", 0, [Body("card", -1.6, 0.2, 7, 3.4, RED, 1.3)], (0,)),
    (
        "statue in a corridor",
        20,
        [*person(0, 6, WHITE), *(Body("post", x, 4, z, 0.3, GREY) for x in (-2, 2) for z in (4, 8, 12))],
        (0, 1),
    ),
    (
        "cup on a table",
        3,
        [Body("card", -1.5, 0, 1.2, 3, WOOD, 1.25), Body("post", 0.05, 1.48, 0.9, 0.09, WHITE)],
        (1,),
    ),
    (
        "bust, close",
        5,
        [Body("sphere", 0.05, 1.55, 0.9, 0.16, SKIN), Body("post", 0.05, 1.36, 0.95, 0.26, BLUE)],
        (0, 1),
    ),
    ("person before a hedge", 0, [*person(-0.4, 4, RED), *leaves(2, 500, (-4, 0, 4, 2.6), 6)], (0, 1)),
    (
        "sign, left",
        0,
        [Body("card", -1.3, 1.2, 3.5, 0.8, YELLOW, 0.6), Body("post", -0.9, 1.2, 3.5, 0.04, GREY)],
        (0,),
    ),
    (
        "behind a fence",
        0,
        [*person(0.2, 4, RED), *(Body("post", x / 4, 1.5, 1.5, 0.025, WOOD) for x in range(-5, 6))],
        (0, 1),
    ),
    (
        "through a window",
        0,
        [
            *person(0.3, 4, BLUE),
            Body("card", -2, 0, 1, 1.6, GREY, 4),
            Body("card", 0.42, 0, 1, 2, GREY, 4),
            Body("card", -2, 1.8, 1, 4, GREY, 2),
            Body("card", -2, 0, 1, 4, GREY, 1.25),
        ],
        (0, 1),
    ),
    ("over the shoulder", 6, [*person(0.15, 3, RED), Body("sphere", -0.5, 1.2, 0.9, 0.3, WOOD)], (0, 1)),
    (
        "speaker before an audience",
        9,
        [*person(0, 6, BLUE, 2.0), *(Body("sphere", x / 5, 1.2, 1.8, 0.12, WOOD) for x in range(-4, 5))],
        (0, 1),
    ),
    (
        "dog, low right",
        0,
        [Body("sphere", 0.8, 0.35, 3.5, 0.35, WOOD), Body("sphere", 0.55, 0.7, 3.4, 0.18, WOOD)],
        (0, 1),
    ),
    (
        "plate behind a bottle",
        3,
        [
            Body("card", -1.5, 0, 1.4, 3, WOOD, 1.2),
            Body("sphere", 0.05, 1.35, 1.1, 0.17, WHITE),
            Body("post", -0.42, 1.7, 0.8, 0.05, LEAF),
        ],
        (1,),
    ),
    ("close to a wall", 4.6, person(-0.1, 4, RED), (0, 1)),
    ("far and small", 0, person(0.4, 11, RED), (0, 1)),
    ("behind a bush", 0, [*person(-0.2, 4, YELLOW), *leaves(3, 90, (-0.8, 0.85, 0.8, 1.2), 1.3)], (0, 1)),
    ("beside a near trunk", 0, [*person(0.5, 3.5, BLUE), Body("post", -0.45, 4, 1.0, 0.12, WOOD)], (0, 1)),
    (
        "two balls, larger one farther",
        0,
        [Body("sphere", 0.1, 0.7, 3.5, 0.6, RED), Body("sphere", -0.95, 0.9, 2.2, 0.2, BLUE)],
        (0,),
    ),
    ("of the ground's colour", 0, person(0.3, 4, (0.2, 0.3, 0.12)), (0, 1)),
    ("open country", 0, [], ()),
    ("bare wall", 6, [], ()),
]


def render(
    wall: float, bodies: list[Body], subject: tuple[int, ...], seed: int, errors: tuple[float, float, float]
) -> tuple[Array, Array, Mask]:
    """Return picture, relative disparity with errors, and subject of a scene, by casting one ray a pixel."""
    blur_px, exponent, noise = errors
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    right = (x - (WIDTH - 1) / 2) / (WIDTH / 2) * _HALF_WIDTH
    up = -(y - (HEIGHT - 1) / 2) / (WIDTH / 2) * _HALF_WIDTH
    depth = np.full((HEIGHT, WIDTH), 1e4)
    image = np.broadcast_to((0.35, 0.5, 0.8), (HEIGHT, WIDTH, 3)).copy()
    number = np.full((HEIGHT, WIDTH), -1)
    floor = np.where(up < 0, _CAMERA_HEIGHT / np.maximum(-up, 1e-9), np.inf)
    layers = [(floor, (0.2, 0.3, 0.12), 1.0, -1)]
    if wall:
        layers.append((np.full_like(depth, wall), (0.5, 0.45, 0.4), 1.0, -1))
    for index, body in enumerate(bodies):
        hit, shade = _hit(body, right, up)
        layers.append((hit, body.color, shade, index))
    for hit, color, shade, index in layers:
        nearer = hit < depth
        depth[nearer], number[nearer] = hit[nearer], index
        texture = 0.75 + 0.5 * resample(rng.uniform(size=(60, 90)).astype(np.float32), HEIGHT, WIDTH)
        light = np.asarray(color) * (shade * texture * rng.uniform(0.8, 1.2, texture.shape))[..., None]
        image[nearer] = light[nearer]
    disparity = 1 / depth
    disparity = ((disparity - disparity.min()) / np.ptp(disparity)) ** exponent
    soft = blurred(disparity, blur_px) + noise * rng.standard_normal(depth.shape)
    return image.astype(np.float32), soft.astype(np.float32), np.isin(number, subject) & (number >= 0)


def _hit(
    body: Body, right: npt.NDArray[np.float64], up: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64] | float]:
    """Return the depth at which rays (right, up, 1) meet a body, infinity if none, and its shading."""
    y0 = body.y - _CAMERA_HEIGHT
    if body.kind == "card":
        across, above = right * body.z, up * body.z
        inside = (
            (across >= body.x) & (across <= body.x + body.size) & (above >= y0) & (above <= y0 + body.tall)
        )
        return np.where(inside, body.z, np.inf), 1.0
    if body.kind == "sphere":
        a, b = right**2 + up**2 + 1, right * body.x + up * y0 + body.z
        c = body.x**2 + y0**2 + body.z**2 - body.size**2
    else:
        a, b, c = right**2 + 1, right * body.x + body.z, body.x**2 + body.z**2 - body.size**2
    root = b**2 - a * c
    depth = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    if body.kind == "post":
        with np.errstate(invalid="ignore"):
            height = up * depth + _CAMERA_HEIGHT
        depth = np.where((height >= 0) & (height <= body.y), depth, np.inf)
    facing = np.sqrt(np.maximum(root, 0)) / (np.sqrt(a) * body.size)
    return depth, 0.3 + 0.7 * np.clip(facing, 0, 1)


def blurred(values: npt.NDArray[np.float64], sigma: float) -> npt.NDArray[np.float64]:
    """Return values (H, W) after a Gaussian blur of ``sigma`` pixels, borders repeated."""
    radius = int(3 * sigma)
    kernel = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * sigma**2))
    kernel /= kernel.sum()
    for axis in (0, 1):
        padded = np.pad(values, [(radius, radius) if axis == one else (0, 0) for one in (0, 1)], mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * radius + 1, axis)
        values = windows @ kernel
    return values


def rendered_cases(maps: str) -> Iterator[Case]:
    """Yield the rendered scenes with maps of one kind."""
    for seed, (name, wall, bodies, subject) in enumerate(SCENES):
        yield Case(name, *render(wall, bodies, subject, seed, MAPS[maps]))

"""Rate of pictures whose subject the automatic focus hits, against subjects chosen by hand.

    python -m benchmarks.quality.subject [--sheet subjects.png] [--faces]

Pictures: scenes rendered here by ray casting (ground, wall, spheres, posts, cards) with fair and poor maps;
photographs of scikit-image with a stereo map or with maps drawn here by hand; the demo; and, where
``../shared`` is present, its photographs and path-traced scenes. The subject of a scene was written down with
the scene, that of a photograph as a rectangle, before the first run.

A picture counts as right if the position lies on the subject and the range of disparities contains the median
of the subject. "sharp" is the fraction of the subject's pixels inside the range, widened by 2 % of the map's.
"others" is the fraction of all other pixels inside it.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.resample import resample
from bokehnet.io.as_image import as_image
from bokehnet.io.image import write_image
from bokehnet.io.maps import read_map
from bokehnet.scene.subject import Subject, detect_faces, find_subject
from bokehnet.tools.contact_sheet import contact_sheet
from bokehnet.tools.demo import demo_scene

Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

SHARED = Path(__file__).resolve().parents[3] / "shared"

HEIGHT, WIDTH = 240, 360

# Height of the camera above the ground, m, and field of view: half the width of the picture at 1 m.
_CAMERA_HEIGHT, _HALF_WIDTH = 1.5, 0.55

# Errors of the maps of rendered scenes: standard deviation of the blur, pixels; exponent; standard deviation
# of the noise.
_MAPS = {"fair maps": (1.5, 0.8, 0.002), "poor maps": (4.0, 0.6, 0.005)}

_TOLERANCE = 0.02


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
    soft = _blurred(disparity, blur_px) + noise * rng.standard_normal(depth.shape)
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


def _blurred(values: npt.NDArray[np.float64], sigma: float) -> npt.NDArray[np.float64]:
    radius = int(3 * sigma)
    kernel = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * sigma**2))
    kernel /= kernel.sum()
    for axis in (0, 1):
        padded = np.pad(values, [(radius, radius) if axis == one else (0, 0) for one in (0, 1)], mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * radius + 1, axis)
        values = windows @ kernel
    return values


# Maps drawn by hand: name, background (far value at the top, near value at the bottom, 0 to 1, and the row at
# which the slope begins), polygons (value, corners as fractions of width and height), index of the subject.
Polygon = tuple[float, list[tuple[float, float]]]
DRAWN: list[tuple[str, tuple[float, float, float], list[Polygon], int]] = [
    (
        "astronaut",
        (0.1, 0.1, 1),
        [
            (0.3, [(0, 0), (0.13, 0), (0.17, 0.5), (0.1, 1), (0, 1)]),
            (
                0.25,
                [
                    (0.68, 0.52),
                    (0.7, 0.12),
                    (0.82, 0),
                    (0.9, 0.15),
                    (0.92, 0.54),
                    (1, 0.55),
                    (1, 1),
                    (0.68, 1),
                ],
            ),
            (
                0.7,
                [
                    (0.05, 1),
                    (0.06, 0.55),
                    (0.25, 0.42),
                    (0.24, 0.3),
                    (0.34, 0.28),
                    (0.3, 0.1),
                    (0.45, 0.02),
                    (0.58, 0.1),
                    (0.55, 0.3),
                    (0.6, 0.4),
                    (0.68, 0.5),
                    (0.7, 0.7),
                    (0.7, 1),
                ],
            ),
            (0.85, [(0.55, 1), (0.56, 0.8), (0.7, 0.68), (0.9, 0.72), (1, 0.95), (1, 1)]),
        ],
        2,
    ),
    (
        "camera",
        (0.05, 0.9, 0.4),
        [
            (
                0.8,
                [
                    (0, 1),
                    (0.02, 0.45),
                    (0.2, 0.26),
                    (0.33, 0.15),
                    (0.46, 0.12),
                    (0.53, 0.22),
                    (0.5, 0.35),
                    (0.6, 0.36),
                    (0.62, 0.42),
                    (0.55, 0.58),
                    (0.42, 0.55),
                    (0.3, 0.75),
                    (0.3, 1),
                ],
            ),
            (
                0.75,
                [
                    (0.5, 0.27),
                    (0.62, 0.27),
                    (0.62, 0.36),
                    (0.59, 0.6),
                    (0.78, 1),
                    (0.76, 1),
                    (0.58, 0.64),
                    (0.48, 1),
                    (0.45, 1),
                    (0.56, 0.6),
                    (0.57, 0.36),
                ],
            ),
        ],
        0,
    ),
    (
        "chelsea",
        (0.1, 0.3, 0.6),
        [
            (0.55, [(0.02, 1), (0, 0.5), (0.03, 0), (0.75, 0), (0.82, 0.4), (0.75, 0.8), (0.6, 1)]),
            (0.75, [(0.2, 1), (0.15, 0.5), (0.3, 0.1), (0.65, 0.1), (0.75, 0.5), (0.68, 0.85), (0.5, 1)]),
        ],
        1,
    ),
    (
        "coffee",
        (0.2, 0.6, 0.0),
        [
            (
                0.5,
                [
                    (0.13, 0.5),
                    (0.2, 0.25),
                    (0.5, 0.15),
                    (0.75, 0.3),
                    (0.8, 0.6),
                    (0.7, 0.85),
                    (0.45, 0.97),
                    (0.2, 0.8),
                ],
            ),
            (
                0.7,
                [
                    (0.28, 0.25),
                    (0.35, 0.08),
                    (0.5, 0.03),
                    (0.65, 0.1),
                    (0.69, 0.3),
                    (0.6, 0.6),
                    (0.45, 0.75),
                    (0.33, 0.6),
                ],
            ),
        ],
        1,
    ),
    (
        "rocket",
        (0.02, 0.1, 0.85),
        [
            (0.6, [(0, 1), (0.03, 0), (0.12, 0), (0.11, 1)]),
            (0.6, [(0.9, 1), (0.88, 0), (0.97, 0), (1, 1)]),
            (0.35, [(0.29, 1), (0.305, 0.3), (0.32, 0.3), (0.33, 1)]),
            (0.35, [(0.69, 1), (0.695, 0.3), (0.705, 0.3), (0.72, 1)]),
            (0.4, [(0.475, 0.97), (0.482, 0.35), (0.5, 0.3), (0.515, 0.35), (0.52, 0.97)]),
        ],
        4,
    ),
]

# Subjects in ../shared: picture, map, and a rectangle on the subject, as fractions of the picture.
_SHARED = [
    ("photograph 3", "real/3.jpg", "real/3.png", (0.54, 0.34, 0.70, 0.52)),
    ("photograph 13", "real/13.jpg", "real/13.png", (0.66, 0.48, 0.82, 0.76)),
    ("photograph 21", "real/21.jpg", "real/21.png", (0.45, 0.32, 0.85, 0.80)),
    (
        "mannequin",
        "real_lens/mannequin/input.png",
        "real_lens/mannequin/disparity.png",
        (0.3, 0.2, 0.65, 0.95),
    ),
    (
        "shop, seller",
        "real_lens/shop_seller/input.png",
        "real_lens/shop_seller/disparity.png",
        (0.47, 0.25, 0.6, 0.5),
    ),
    (
        "still life",
        "cycles/s1_still_life/image.png",
        "cycles/s1_still_life/disparity.png",
        (0.3, 0.42, 0.55, 0.7),
    ),
    (
        "corridor",
        "cycles/s4_corridor/image.png",
        "cycles/s4_corridor/disparity.png",
        (0.51, 0.56, 0.61, 0.74),
    ),
    ("crowd", "cycles/s8_crowd/image.png", "cycles/s8_crowd/disparity.png", (0.5, 0.57, 0.72, 0.82)),
]


def rendered_cases(maps: str) -> Iterator[Case]:
    """Yield the rendered scenes with maps of one kind."""
    for seed, (name, wall, bodies, subject) in enumerate(SCENES):
        yield Case(name, *render(wall, bodies, subject, seed, _MAPS[maps]))


def photograph_cases() -> Iterator[Case]:
    """Yield the demo and photographs of scikit-image, with a stereo map or drawn ones."""
    demo = demo_scene()
    height, width = demo.image.shape[:2]
    yield Case("demo", demo.image, demo.depth.values, _rectangle((0.27, 0.42, 0.58, 0.86), height, width))
    from skimage import data

    stereo, _, values = data.stereo_motorcycle()
    values = np.nan_to_num(values, nan=0, posinf=0, neginf=0).astype(np.float32)
    low = float(values[values > 0].min())
    yield Case(
        "motorcycle",
        as_image(stereo),
        np.maximum(values, low),
        _rectangle((0.15, 0.2, 0.9, 0.95), *values.shape)
        & (values > 0.7 * values.max())
        & (values < 0.92 * values.max()),
    )
    for name, (far, near, begin), polygons, subject in DRAWN:
        image = as_image(getattr(data, name)())
        height, width = image.shape[:2]
        rows = np.linspace(0, 1, height)[:, None]
        slope = np.clip((rows - begin) / max(1 - begin, 1e-9), 0, 1)
        disparity = np.broadcast_to(far + (near - far) * slope, (height, width)).copy()
        number = np.full((height, width), -1)
        for index, (value, corners) in enumerate(polygons):
            inside = _inside(corners, height, width)
            disparity[inside], number[inside] = value, index
        soft = _blurred(disparity, 0.004 * width).astype(np.float32)
        yield Case(name, image, soft, number == subject)


def shared_cases() -> Iterator[Case]:
    """Yield the pictures of ``../shared``, if it is there."""
    for name, picture, disparity, box in _SHARED:
        if (SHARED / picture).exists():
            values = read_map(SHARED / disparity)
            yield Case(name, as_image(SHARED / picture), values, _rectangle(box, *values.shape))


def _rectangle(box: tuple[float, float, float, float], height: int, width: int) -> Mask:
    mask = np.zeros((height, width), bool)
    left, top, right, bottom = box
    mask[round(top * height) : round(bottom * height), round(left * width) : round(right * width)] = True
    return mask


def _inside(corners: list[tuple[float, float]], height: int, width: int) -> Mask:
    """Return the pixels inside a polygon, by the parity of crossings."""
    y, x = np.mgrid[0:height, 0:width]
    x, y = (x + 0.5) / width, (y + 0.5) / height
    inside = np.zeros((height, width), bool)
    for (x0, y0), (x1, y1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if y0 != y1:
            inside ^= ((y0 > y) != (y1 > y)) & (x < (x1 - x0) * (y - y0) / (y1 - y0) + x0)
    return inside


def score(case: Case, subject: Subject) -> tuple[bool, float, float]:
    """Return whether the subject is right, and the fractions of its own and of other pixels in the range."""
    if not case.subject.any():
        return subject.is_fallback, float("nan"), float("nan")
    column, row = subject.position
    margin = _TOLERANCE * float(np.ptp(case.disparity))
    median = float(np.median(case.disparity[case.subject]))
    in_range = (case.disparity >= subject.far - margin) & (case.disparity <= subject.near + margin)
    is_right = bool(case.subject[row, column]) and subject.far - margin <= median <= subject.near + margin
    others = float(in_range[~case.subject].mean())
    return is_right, float(in_range[case.subject].mean()), others


def _shown(case: Case, subject: Subject) -> Array:
    """Return the picture with everything outside the range darkened, and a cross at the position."""
    image = resample(case.image, *case.disparity.shape, "area")
    in_range = (case.disparity >= subject.far) & (case.disparity <= subject.near)
    shown = np.minimum(image, 1) * np.where(in_range, 1, 0.15)[..., None]
    column, row = subject.position
    arm = max(case.disparity.shape) // 30
    shown[row, max(column - arm, 0) : column + arm] = (1, 0, 0)
    shown[max(row - arm, 0) : row + arm, column] = (1, 0, 0)
    height, width = 150, 225
    scale = min(height / image.shape[0], width / image.shape[1])
    size = round(scale * image.shape[0]), round(scale * image.shape[1])
    framed = np.zeros((height, width, 3), np.float32)
    framed[: size[0], : size[1]] = resample(shown.astype(np.float32), *size, "area")
    return framed


def main(arguments: list[str] | None = None) -> None:
    """Print one line per picture, and the rate."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sheet", type=Path, help="write a sheet of all pictures")
    parser.add_argument("--faces", action="store_true", help="detect faces")
    options = parser.parse_args(arguments)
    rendered = {f"rendered, {maps}": rendered_cases(maps) for maps in _MAPS}
    groups = {**rendered, "photographs": photograph_cases(), "shared": shared_cases()}
    shown, rights = [], {}
    print(f"{'picture':30} {'right':6} {'sharp':>6} {'others':>7} {'certainty':>10}  choice")
    for group, cases in groups.items():
        rights[group] = []
        for case in cases:
            subject = find_subject(case.image, case.disparity, faces=detect_faces if options.faces else None)
            is_right, sharp, others = score(case, subject)
            rights[group].append(is_right)
            choice = (
                f"{subject.position[0]},{subject.position[1]}{' (fallback)' if subject.is_fallback else ''}"
            )
            print(
                f"{case.name:30} {'yes' if is_right else 'NO':6} {sharp:6.2f} {others:7.2f} "
                f"{subject.certainty:10.2f}  {choice}"
            )
            shown.append((f"{case.name}{'' if is_right else ': WRONG'}", _shown(case, subject)))
    for group, results in rights.items():
        print(f"{group}: {sum(results)} of {len(results)} right")
    total = [result for results in rights.values() for result in results]
    print(f"all: {sum(total)} of {len(total)} right")
    if options.sheet is not None:
        write_image(
            options.sheet, contact_sheet([shown[start : start + 5] for start in range(0, len(shown), 5)])
        )


if __name__ == "__main__":
    main()

"""Photographs with a subject chosen by hand, with stereo maps, estimated maps or maps drawn by hand."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.quality.scenes.subject_scenes import Case, blurred
from bokehnet.io.as_image import as_image
from bokehnet.io.maps import read_map
from bokehnet.tools.demo import demo_scene

__all__ = ["photograph_cases", "shared_cases"]

Mask = npt.NDArray[np.bool_]

SHARED = Path(__file__).resolve().parents[4] / "shared"

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
        soft = blurred(disparity, 0.004 * width).astype(np.float32)
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

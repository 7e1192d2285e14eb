"""Write a street at night, scene-linear with lamps up to 300 times white, and its disparity.

``python examples/night_scene.py --out FOLDER`` writes ``night.exr`` and ``night_disparity.exr``: a picture
without clipped light, for looks that depend on lights. Disparity is 1 near and 0 far.
"""

import argparse
from pathlib import Path

import numpy as np

import bokehnet

WIDTH, HEIGHT = 960, 640

# Disparity of the person, who is in focus, and of the lights in front.
FOCUS, NEAR = 0.6, 0.95

# Row of the horizon, and the disparity of the road at the lower border.
HORIZON, ROAD = 300, 0.9

_LAMP_COLORS = np.array(
    [[1.0, 0.62, 0.25], [1.0, 0.8, 0.5], [0.6, 0.8, 1.0], [1.0, 0.25, 0.2], [0.3, 1.0, 0.5]]
)


def _discs(image: np.ndarray, disparity: np.ndarray, lights: np.ndarray) -> None:
    """Draw unoccluded lights, rows (x, y, radius, disparity, red, green, blue), with smooth rims."""
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    for column, row, radius, depth, *color in lights:
        coverage = np.clip(radius + 0.5 - np.hypot(x - column, y - row), 0, 1)[..., None]
        if (disparity[coverage[..., 0] > 0] > depth).any():
            continue
        image[:] = image * (1 - coverage) + coverage * np.array(color)
        disparity[coverage[..., 0] > 0] = depth


def _houses(rng: np.random.Generator, image: np.ndarray, disparity: np.ndarray) -> None:
    """Draw two rows of houses along the road, with lit windows."""
    for side in (-1, 1):
        for number, depth in enumerate(np.linspace(0.06, 0.4, 6)):
            middle = WIDTH / 2 + side * (90 + 900 * depth)
            half, top = 60 + 260 * depth, HORIZON - 60 - 560 * depth * (0.8 + 0.4 * rng.random())
            left, right = int(max(0, middle - half)), int(min(WIDTH, middle + half))
            bottom = int(HORIZON + (HEIGHT - HORIZON) * depth / ROAD)
            image[max(0, int(top)) : bottom, left:right] = 0.012 + 0.008 * rng.random(3)
            disparity[max(0, int(top)) : bottom, left:right] = depth
            size = int(6 + 50 * depth)
            for y in range(max(4, int(top) + size), bottom - 2 * size, 2 * size):
                for x in range(left + size // 2, right - size, int(1.7 * size)):
                    if rng.random() < 0.35 and number < 5:
                        warm = np.array([1.0, 0.72, 0.4]) if rng.random() < 0.8 else np.array([0.6, 0.8, 1.0])
                        image[y : y + size, x : x + int(0.7 * size)] = warm * rng.uniform(0.3, 3)


def _person(rng: np.random.Generator, image: np.ndarray, disparity: np.ndarray) -> None:
    """Draw a person with an umbrella, lit from behind."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    head = np.hypot((x - 500) / 26, (y - 330) / 32) < 1
    body = (np.abs(x - 500) < 38 + 34 * np.clip((y - 360) / 200, 0, 1)) & (y > 352)
    umbrella = (np.hypot((x - 490) / 120, (y - 318) / 70) < 1) & (y < 300 + 10 * np.cos((x - 490) / 12.7))
    stick = (np.abs(x - 494 - 0.08 * (y - 300)) < 2) & (y > 296) & (y < 420)
    cloth = 0.04 + 0.02 * np.sin(x / 6 + 0.4 * np.sin(y / 40)) + 0.015 * rng.random((HEIGHT, WIDTH))
    for part, color in (
        (body, (0.9, 0.35, 0.25)),
        (head, (1.6, 1.1, 0.8)),
        (umbrella, (2.2, 0.4, 0.3)),
        (stick, (1, 1, 1)),
    ):
        light = cloth * (1 + 6 * np.exp(-((x - 430.0) ** 2) / 900))
        image[part] = (light[..., None] * np.array(color))[part]
        disparity[part] = FOCUS


def night_scene() -> tuple[np.ndarray, np.ndarray]:
    """Return the picture (H, W, 3), scene-linear, and its disparity (H, W) in [0, 1]."""
    rng = np.random.default_rng(7)
    y = np.arange(HEIGHT)[:, None, None]
    sky = np.array([0.008, 0.012, 0.03]) * (0.6 + y / HORIZON)
    road = np.array([0.02, 0.02, 0.024]) * (1 + 0.4 * rng.random((HEIGHT, WIDTH, 1)))
    image = np.where(y < HORIZON, sky, road) * np.ones((HEIGHT, WIDTH, 1))
    disparity = np.where(y < HORIZON, 0.0, ROAD * (y - HORIZON) / (HEIGHT - HORIZON))[..., 0] * np.ones(
        (1, WIDTH)
    )
    _houses(rng, image, disparity)
    lamps = []
    for side in (-1, 1):
        for depth in np.geomspace(0.03, 0.42, 9):
            x = WIDTH / 2 + side * (40 + 560 * depth)
            lamps.append((x, HORIZON - 30 - 420 * depth, 1 + 5 * depth, depth, *(200 * _LAMP_COLORS[0])))
            lamps.append((x + 3, HORIZON + 6 + 300 * depth, 0.8 + 2 * depth, depth, *(12 * _LAMP_COLORS[0])))
    for _ in range(60):
        depth = rng.uniform(0.02, 0.25)
        color = _LAMP_COLORS[rng.integers(len(_LAMP_COLORS))] * 10 ** rng.uniform(0.8, 2.2)
        x = WIDTH / 2 + rng.normal() * (60 + 700 * depth)
        lamps.append((x, HORIZON - 10 + rng.uniform(-200, 120) * depth, 0.8 + 3 * depth, depth, *color))
    _discs(image, disparity, np.array(lamps))
    _person(rng, image, disparity)
    near = [
        (60 + 100 * i, 60 + 22 * np.sin(1.3 * i), 3.0, NEAR, *(40 * _LAMP_COLORS[i % 5])) for i in range(9)
    ]
    _discs(image, disparity, np.array(near))
    return image.astype(np.float32), disparity.astype(np.float32)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    image, disparity = night_scene()
    bokehnet.write_image(folder / "night.exr", image)
    bokehnet.write_image(folder / "night_disparity.exr", np.repeat(disparity[..., None], 3, axis=-1))


if __name__ == "__main__":
    main()

"""Trace the picture of ``bokehnet demo`` and its disparity with the package's ray tracer.

Printed photographs on a table in the evening, leaves in front of the camera, lamps and a town behind. This
command, from the root of the repository, makes the files that ship with the package::

    python examples/demo_scene.py --out bokehnet/assets

``--truth DIR`` also writes the ray-traced pictures with bokeh for the focus distances of the demo.
The photographs are samples in the wheel of scikit-image: Chelsea (CC0, by Stefan van der Walt), Coffee
(CC0, by Rachel Michetti), Eileen Collins and a Falcon 9 launch (public domain, NASA and SpaceX).
"""

import argparse
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from numpy.typing import ArrayLike
from torch import Tensor

from bokehnet.cli.progress import progress
from bokehnet.errors import ImageFileError
from bokehnet.io.image import read_image, write_image
from bokehnet.raytrace import (
    Background,
    Camera,
    Plane,
    Scene,
    background_from,
    plane_texture,
    render_all_in_focus,
    render_bokeh,
    render_disparity,
)
from bokehnet.raytrace.surfaces.shapes import Canvas
from bokehnet.raytrace.surfaces.textures import fractal_noise
from bokehnet.synth import SynthConfig
from bokehnet.synth.pairs import lens_for_view
from bokehnet.synth.photographs import photograph_files
from bokehnet.tools.demo import BLUR, FOCUS

SEED = 7
WIDTH, HEIGHT = 720, 480
SENSOR_WIDTH = 36.0  # mm
SENSOR_DISTANCE = 50.0  # mm
DENSITY = SENSOR_DISTANCE * WIDTH / SENSOR_WIDTH  # pixels per unit of slope (lateral extent over depth)
HALF = np.array([WIDTH, HEIGHT]) / 2 / DENSITY  # slopes at the edges of the picture
TABLE = 185.0  # mm: the table lies this far below the camera
TABLE_NEAR, TABLE_FAR, TABLE_SIDE = 520.0, 2300.0, 1300.0  # mm
NEAREST = 470.0  # mm: the leaves

# Photographs: file, crop (top, left, height, width), width mm, foot (x, z) mm, yaw and tilt in degrees.
PRINTS = (
    ("chelsea", (0, 62, 300, 330), 275.0, (-45.0, 1000.0), 14.0, 12.0),
    ("coffee", (20, 90, 370, 330), 215.0, (290.0, 1240.0), -24.0, 10.0),
    ("astronaut", (0, 60, 400, 340), 255.0, (-415.0, 1560.0), 20.0, 8.0),
    ("rocket", (20, 190, 400, 300), 215.0, (225.0, 1950.0), -8.0, 8.0),
)


def make_scene(rng: np.random.Generator) -> Scene:
    """Build the scene; x to the right, y down, z away from the camera, mm."""
    prints = [make_print(*recipe) for recipe in PRINTS]
    planes = [make_table(prints, rng), *prints, make_lamps(rng), make_leaves(rng), make_grass(rng)]
    return Scene(background=make_town(rng), planes=tuple(planes))


def make_print(
    name: str,
    part: tuple[int, int, int, int],
    width: float,
    foot: tuple[float, float],
    yaw: float,
    tilt: float,
) -> Plane:
    """Return a photograph with a white border on the table, with yaw and tilt."""
    top, left, rows, columns = part
    photograph = read_image(photograph_files((name,))[0])[top : top + rows, left : left + columns]
    border = round(0.05 * columns)
    sheet = np.pad(photograph * 0.85, ((border, border), (border, border), (0, 0)), constant_values=0.5)
    height = width * sheet.shape[0] / sheet.shape[1]
    yaw_angle, tilt_angle = np.radians(yaw), np.radians(tilt)
    right = np.array([np.cos(yaw_angle), 0, np.sin(yaw_angle)])
    down = np.array(
        [np.sin(yaw_angle) * np.sin(tilt_angle), np.cos(tilt_angle), -np.cos(yaw_angle) * np.sin(tilt_angle)]
    )
    centre = np.array([foot[0], TABLE, foot[1]]) - down * height / 2
    return _plane(plane_texture(sheet), centre, right * width / 2, down * height / 2)


def make_table(prints: list[Plane], rng: np.random.Generator) -> Plane:
    """Return planks that recede from the camera, one texel per mm, with contact shadows of ``prints``."""
    rows, columns = int(TABLE_FAR - TABLE_NEAR), int(2 * TABLE_SIDE)
    z = TABLE_FAR - 0.5 - np.arange(rows)[:, None]
    x = np.arange(columns)[None] + 0.5 - TABLE_SIDE
    plank = np.floor(x / 150).astype(int) + 20
    tone = rng.uniform(0.65, 1.15, 40)[plank][..., None]
    grain = np.repeat(fractal_noise(rows // 20 + 1, columns, rng, 0.7), 20, axis=0)[:rows]
    slow = fractal_noise(rows, columns, rng, 1.8)
    wood = tone * (0.45 + 0.75 * _smooth_rows(grain, 20) * (0.4 + slow))[..., None]
    gap = np.clip(np.abs(x % 150 - 75) - 72.5, 0, 1)[..., None]
    light = np.ones((rows, columns))
    for sheet in prints:
        low = np.array(sheet.centre) + sheet.v_axis
        side = np.array(sheet.u_axis)
        along = np.clip(((x - low[0]) * side[0] + (z - low[2]) * side[2]) / (side @ side), -1, 1)
        distance = np.hypot(x - low[0] - along * side[0], z - low[2] - along * side[2])
        light *= 1 - 0.75 * np.exp(-distance / 45)
    colour = np.array([0.34, 0.17, 0.075]) * wood * (1 - 0.8 * gap) * light[..., None]
    middle = np.array([0, TABLE, (TABLE_NEAR + TABLE_FAR) / 2])
    return _plane(plane_texture(colour), middle, [TABLE_SIDE, 0, 0], [0, 0, -(TABLE_FAR - TABLE_NEAR) / 2])


def make_lamps(rng: np.random.Generator) -> Plane:
    """Return bulbs with hot cores on two slack wires, one texel per pixel, across the picture."""
    depth, half = 3400.0, HALF * 1.15
    height, width = int(2 * half[1] * DENSITY), int(2 * half[0] * DENSITY)
    wire = Canvas(height, width)
    colour, alpha = np.zeros((height, width, 3)), np.zeros((height, width))
    for top, sag, count in ((0.09, 0.13, 10), (0.17, 0.11, 8)):
        t = np.linspace(-0.02, 1.02, 80)
        curve = np.stack([t * width, (top + 4 * sag * t * (1 - t) - 0.05 * t) * height], -1)
        wire.add_path(curve, np.full(len(curve), 0.6))
        for k in range(count):
            place = curve[int((k + rng.uniform(0.3, 0.7)) * len(curve) / count)] + [0, 8.0]
            radius = rng.uniform(5.5, 7.5)
            tint = np.array([1.0, rng.uniform(0.5, 0.72), rng.uniform(0.12, 0.34)])
            _lamp(colour, alpha, place, radius, tint)
            _lamp(colour, alpha, place, 0.4 * radius, 3.0 * tint**0.7)
    cover = np.maximum(alpha, wire.alpha)
    colour = np.where(alpha[..., None] > 0, colour, 0.004)
    return _plane(
        plane_texture(colour, cover), [0, 0, depth], [half[0] * depth, 0, 0], [0, half[1] * depth, 0]
    )


def make_town(rng: np.random.Generator) -> Background:
    """Return an evening sky over dark houses with bright windows at infinity."""
    half = HALF * 1.1
    height, width = int(2 * half[1] * DENSITY), int(2 * half[0] * DENSITY)
    y = np.linspace(-1.1, 1.1, height)[:, None, None]
    glow = np.exp(-(((y - 0.15) / 0.45) ** 2))
    sky = np.array([0.008, 0.014, 0.04]) + glow * np.array([0.09, 0.035, 0.045])
    sky = sky * (0.7 + 0.6 * fractal_noise(height, width, rng, 1.7)[..., None])
    opaque = np.ones((height, width))
    left = 0
    while left < width:
        size = int(rng.uniform(30, 75))
        roof = int(height * rng.uniform(0.2, 0.36))
        sky[roof:, left : left + size] = np.array([0.006, 0.007, 0.011]) * rng.uniform(0.6, 1.8)
        for _ in range(rng.integers(3, 6)):
            place = np.array([left + rng.uniform(9, max(10, size - 9)), roof + rng.uniform(10, 125)])
            warm = np.array([1.0, rng.uniform(0.5, 0.9), rng.uniform(0.1, 0.7)])
            cold = np.array([0.35, rng.uniform(0.6, 0.9), 1.0])
            _lamp(sky, opaque, place, rng.uniform(3.0, 5.2), warm if rng.random() < 0.75 else cold)
        left += size
    return background_from(sky, (float(half[0]), float(half[1])))


def make_leaves(rng: np.random.Generator) -> Plane:
    """Return a twig with leaves that hangs into the picture from above, two texels per pixel."""
    half = np.array([0.25, 0.17])
    height, width = (int(4 * h * DENSITY) for h in half[::-1])
    colour, alpha = np.zeros((height, width, 3)), np.zeros((height, width))
    t = np.linspace(0, 1, 30)
    twig = np.stack([(1 - 0.86 * t) * width, (0.04 + 0.30 * t + 0.22 * t**2) * height], -1)
    _paint(colour, alpha, twig, np.linspace(7, 2.5, len(twig)), np.array([0.05, 0.028, 0.014]))
    for k in range(3, 30, 2):
        ahead = np.arctan2(*(twig[k] - twig[k - 1])[::-1])
        for side in (-1, 1):
            angle = ahead + side * rng.uniform(0.6, 1.05)
            length = rng.uniform(62, 88) * (1 - 0.35 * t[k])
            centre = twig[k] + (length + rng.uniform(10, 20)) * np.array([np.cos(angle), np.sin(angle)])
            _paint(
                colour, alpha, np.stack([twig[k], centre]), np.array([1.8, 1.2]), np.array([0.06, 0.06, 0.02])
            )
            _leaf(colour, alpha, centre, angle, length, rng)
    z = NEAREST * 1.06
    middle = np.array([HALF[0] + 0.02 - half[0], -HALF[1] - 0.02 + half[1], 1]) * z
    return _plane(
        plane_texture(colour, alpha), middle, [half[0] * z, 0, -0.05 * z], [0.0, half[1] * z, 0.01 * z]
    )


def make_grass(rng: np.random.Generator) -> Plane:
    """Return thin blades of grass in front of the camera at the lower left, two texels per pixel."""
    half = np.array([0.13, 0.17])
    height, width = (int(4 * h * DENSITY) for h in half[::-1])
    colour, alpha = np.zeros((height, width, 3)), np.zeros((height, width))
    t = np.linspace(0, 1, 16)
    for _ in range(17):
        foot, bend, tall = rng.uniform(0.05, 0.6), rng.uniform(-0.2, 0.45), rng.uniform(0.45, 0.97)
        blade = np.stack([(foot + bend * t**2) * width, (1 - tall * t) * height], -1)
        green = np.array([0.11, 0.17, 0.035]) * rng.uniform(0.4, 1.6)
        _paint(colour, alpha, blade, np.linspace(rng.uniform(2.5, 5.5), 0.8, len(t)), green)
    z = NEAREST * 1.2
    middle = np.array([-HALF[0] - 0.01 + half[0], HALF[1] + 0.02 - half[1], 1]) * z
    return _plane(plane_texture(colour, alpha), middle, [half[0] * z, 0, 0], [0, half[1] * z, 0])


def _leaf(
    colour: np.ndarray,
    alpha: np.ndarray,
    centre: np.ndarray,
    angle: float,
    length: float,
    rng: np.random.Generator,
) -> None:
    """Composite a leaf with midrib and veins over the canvas; its halves have different shading."""
    canvas = Canvas(*alpha.shape)
    breadth = length * rng.uniform(0.34, 0.44)
    canvas.add_leaf(centre, angle, length, breadth)
    y, x = np.indices(alpha.shape) + 0.5 - centre[::-1, None, None]
    along = (np.cos(angle) * x + np.sin(angle) * y) / length
    across = (np.cos(angle) * y - np.sin(angle) * x) / breadth
    veins = 0.5 + 0.5 * np.cos(26 * (along - 0.35 * np.abs(across)))
    shade = np.where(across > 0, 1.0, 0.6) * (0.85 + 0.25 * along) * (0.82 + 0.18 * veins**2)
    rib = np.exp(-((across * breadth / 2.2) ** 2))
    green = np.array([rng.uniform(0.09, 0.26), rng.uniform(0.2, 0.28), 0.03]) * rng.uniform(0.7, 1.25)
    _over(colour, alpha, (shade + 0.8 * rib)[..., None] * green, canvas.alpha)


def _paint(
    colour: np.ndarray, alpha: np.ndarray, points: np.ndarray, radii: np.ndarray, ink: np.ndarray
) -> None:
    """Composite a chain of strokes over the canvas."""
    canvas = Canvas(*alpha.shape)
    canvas.add_path(points, radii)
    _over(colour, alpha, ink, canvas.alpha)


def _lamp(
    colour: np.ndarray, alpha: np.ndarray, centre: np.ndarray, radius: float, light: np.ndarray
) -> None:
    """Composite a bright disc over the canvas."""
    canvas = Canvas(*alpha.shape)
    canvas.add_stroke(centre, centre, radius, radius)
    _over(colour, alpha, light, canvas.alpha)


def _over(colour: np.ndarray, alpha: np.ndarray, ink: np.ndarray, coverage: np.ndarray) -> None:
    """Composite straight ``ink`` over straight ``colour``, in place; uncovered texels take the ink fully."""
    mix = np.where(alpha > 0, coverage, (coverage > 0).astype(float))[..., None]
    colour += mix * (ink - colour)
    alpha[...] = np.maximum(alpha, coverage)


def _smooth_rows(values: np.ndarray, size: int) -> np.ndarray:
    """Return the running mean of ``size`` rows."""
    total = np.cumsum(np.pad(values, ((size // 2, size - size // 2), (0, 0)), mode="edge"), axis=0)
    return (total[size:] - total[:-size]) / size


def _plane(texture: Tensor, centre: ArrayLike, u_axis: ArrayLike, v_axis: ArrayLike) -> Plane:
    """Return a :class:`Plane` from array-like vectors."""
    c, u, v = (tuple(np.asarray(vector, float).tolist()) for vector in (centre, u_axis, v_axis))
    return Plane(texture=texture, centre=c, u_axis=u, v_axis=v)


def write_disparity(path: Path, disparity: np.ndarray) -> None:
    """Write a map in [0, 1] as a grey PNG of 16 bits."""
    grey = np.rint(disparity * 65535).astype(np.uint16)[..., None]
    if not oiio.ImageBuf(np.ascontiguousarray(grey)).write(str(path)):
        raise ImageFileError(f"{path}: cannot be written: {oiio.geterror()}")


def main() -> None:
    """Parse the command line and write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for demo.png and demo_disparity.png")
    parser.add_argument("--truth", type=Path, help="folder for the ray-traced bokeh (slow)")
    parser.add_argument(
        "--samples", type=int, default=64, help="rays per pixel; the truth uses six times as many"
    )
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    scene = make_scene(np.random.default_rng(SEED))

    def camera(blur: float, focus: float, nearest: float) -> Camera:
        config = SynthConfig(
            seed=SEED,
            scenes=1,
            width=WIDTH,
            height=HEIGHT,
            sensor_width=SENSOR_WIDTH,
            sensor_distance=SENSOR_DISTANCE,
            nearest_distance=nearest,
        )
        lens = lens_for_view(blur, focus, config)
        return Camera(lens=lens, width=WIDTH, height=HEIGHT, pixel_pitch=config.pixel_pitch)

    sharp = camera(BLUR, 0.0, NEAREST)
    disparity = render_disparity(scene, sharp).numpy()
    nearest = 1 / float(disparity.max())  # the file is scaled to [0, 1]; the town is already at 0
    write_disparity(options.out / "demo_disparity.png", disparity * nearest)
    with progress("tracing the picture") as report:
        picture = render_all_in_focus(scene, sharp, options.samples, SEED, report).numpy()
    write_image(options.out / "demo.png", picture)
    if options.truth is None:
        return
    options.truth.mkdir(parents=True, exist_ok=True)
    for name, focus in FOCUS.items():
        with progress(f"tracing the truth, focus {name}") as report:
            truth = render_bokeh(scene, camera(BLUR, focus, nearest), 6 * options.samples, SEED, report)
        write_image(options.truth / f"truth_{name}.png", truth.numpy())


if __name__ == "__main__":
    main()

"""Fit of a look to a picture of an independent renderer with a glass lens.

Run ``python -m benchmarks.experiments.looks.independent_look``.

Mitsuba 3 traces particles from lamps through a hood, an iris with straight blades and a biconvex lens of
N-BK7, all as meshes, onto a white screen in view of its camera: refraction, rims and colours are those of
Mitsuba. The picture gets noise and JPEG compression, and the function behind ``bokehnet lens fit`` fits it.
The truth follows from formulas: the blades are known, the cat's-eye is the shift of the hood relative to the
iris in the corner, both colour errors are paraxial, and there is no dark core. Needs Mitsuba (``pip install
mitsuba``).
"""

import argparse
import importlib.util
import math
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from bokehnet.io.image import read_image, write_image
from bokehnet.lenses.fit.discs import find_discs
from bokehnet.lenses.fit.fit import fit_look
from bokehnet.optics.aberrations.chromatic_aberration import glass_curve
from bokehnet.optics.spectral.glass import make_glass
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

WIDTH, HEIGHT, PITCH = 480, 320, 0.04  # pixels, mm
HALF = 0.5 * math.hypot(WIDTH, HEIGHT)
GREY = np.array([0.2126, 0.7152, 0.0722])
# Lens, mm: radius of both sides, thickness, half width; distance and radius of the iris in front.
CURVE, THICK, WIDE, IRIS, OPENING = 103.0, 4.0, 14.0, 6.0, 6.0
HOOD, FOCUS, LAMPS = 35.0, 500.0, 3000.0  # mm in front of the iris
# Parameters and the ranges to which errors refer, as in benchmarks.experiments.looks.look_fit.
RANGES = {"curvature": 1.0, "obstruction": 0.95, "cats_eye": 1.5, "axial": 2.0, "lateral": 2.0}


def image_distance(index: float, depth: float) -> float:
    """Return the paraxial distance from the lens back to the image of a point, mm; depth from the iris."""
    before = 1 / CURVE * (index - 1) - 1 / (depth + IRIS)  # n over the distance behind the first side
    inside = index / before - THICK
    return 1 / (index / inside + (index - 1) / CURVE)


def on_screen(index: float, screen: float, height: float, angle: float) -> float:
    """Return the position of a paraxial ray on the screen, mm, from its height and slope at the iris."""
    height += angle * IRIS
    angle -= height * (index - 1) / CURVE  # n times the slope
    height += angle / index * THICK
    return height + (angle - height * (index - 1) / CURVE) * screen


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--particles", type=int, default=150_000, help="particles of each lamp and colour")
    parser.add_argument("--blades", type=int, default=6)
    parser.add_argument("--rotation", type=float, default=14.0, help="degrees")
    parser.add_argument("--picture", type=Path, help="also write the photograph to this file")
    options = parser.parse_args()
    if importlib.util.find_spec("mitsuba") is None:
        print("skipped: mitsuba is not installed (pip install mitsuba)")
        return
    sampled, _ = WavelengthSampling(dispersion="rgb").at((np.arange(3) + 0.5) / 3)
    indices = [float(make_glass("N-BK7").index(nm)) for nm in sampled]
    screen = image_distance(indices[1], FOCUS)
    radii = np.array([on_screen(index, screen, OPENING, OPENING / LAMPS) for index in indices]) / PITCH
    middles = np.array([on_screen(index, screen, 0.0, 1.0) for index in indices])
    begin = time.perf_counter()
    picture = photograph(indices, screen, options)
    print(f"traced by Mitsuba in {time.perf_counter() - begin:.0f} s")
    rng = np.random.default_rng(0)
    picture = picture + rng.normal(size=picture.shape) * np.sqrt(2e-6 + 4e-4 * picture)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lamps.jpg" if options.picture is None else options.picture
        write_image(path, np.clip(picture, 0, 1).astype(np.float32), quality=92)
        image = read_image(path)
    discs = find_discs(image @ GREY)
    fit = fit_look(image, discs)
    # Radii of the colours are linear in the glass curve, r = r0 - axial / 100 * curve * half-diagonal, and so
    # are their image sizes.
    curve = glass_curve("N-BK7")(sampled)
    slope, wider = (np.polyfit(curve, values, 1)[0] for values in (radii, middles / middles[1]))
    corner = HALF * PITCH / middles[1]  # slope of the ray through the centre of the iris
    truth = {
        "curvature": 0.0,
        "obstruction": 0.0,
        "cats_eye": HOOD * LAMPS / (LAMPS - HOOD) * corner / OPENING,
        "axial": -100 * float(slope) / HALF,
        "lateral": 100 * float(wider),
    }
    print(f"{len(fit.discs)} lamps of {len(discs)} found; left of their light {fit.residual:.4f}")
    print("parameter | truth | found | deviation | error, % of range\n---|---|---|---|---")
    print(f"blades | {options.blades} | {fit.look.blades} | |")
    period = 360 / options.blades
    difference = (fit.look.rotation - options.rotation + period / 2) % period - period / 2
    row = f"{options.rotation % period:.2f} | {fit.look.rotation % period:.2f}"
    print(
        f"rotation | {row} | {fit.deviation.get('rotation', math.nan):.2g} | "
        f"{100 * abs(difference) / period:.2f}"
    )
    for name, value in truth.items():
        fitted, deviation = getattr(fit.look, name), fit.deviation.get(name, math.nan)
        error = 100 * abs(fitted - value) / RANGES[name]
        print(f"{name} | {value:.4f} | {fitted:.4f} | {deviation:.2g} | {error:.2f}")
    fitted_radius = float(np.median([abs(disc.radius) for disc in fit.discs]))
    print(f"radius, pixels | {abs(radii[1]):.2f} | {fitted_radius:.2f} | |")
    print(f"rim, of the lens's spherical aberration: {fit.look.spherical_profile:.3f}")


def photograph(indices: list[float], screen: float, options: argparse.Namespace) -> np.ndarray:
    """Return lamps on a 3 by 3 grid, (HEIGHT, WIDTH, 3), with the brightest part of their discs at 0.7."""
    import mitsuba as mi  # type: ignore[import-not-found, import-untyped, unused-ignore]

    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Warn)
    end = IRIS + THICK + screen
    lamp_positions = np.stack(np.meshgrid([-0.8, 0.0, 0.78], [-0.76, 0.02, 0.74]), -1).reshape(-1, 2)
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    layers = []
    for number, index in enumerate(indices):
        scene: dict[str, Any] = {
            "type": "scene",
            "integrator": {"type": "ptracer", "max_depth": 5, "hide_emitters": True},
            "screen": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, end], target=[0, 0, 0], up=[0, 1, 0])
                @ mi.ScalarTransform4f().scale([60, 60, 1]),
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}},
            },
            "sensor": {
                "type": "perspective",
                "fov": 2 * math.degrees(math.atan(WIDTH * PITCH / 2 / 60)),
                "fov_axis": "x",
                "near_clip": 1.0,
                "to_world": mi.ScalarTransform4f().look_at(
                    origin=[0, 0, end - 60], target=[0, 0, end], up=[0, -1, 0]
                ),
                "film": {
                    "type": "hdrfilm",
                    "width": WIDTH,
                    "height": HEIGHT,
                    "pixel_format": "luminance",
                    "rfilter": {"type": "box"},
                },
                "sampler": {
                    "type": "independent",
                    "sample_count": math.ceil(options.particles * len(lamp_positions) / (WIDTH * HEIGHT)),
                    "seed": number,
                },
            },
            "iris": _plate(mi, _blades(options.blades, options.rotation), 0.0, black),
            "hood": _plate(mi, _circle(OPENING * (LAMPS - HOOD) / LAMPS), -HOOD, black),
            "glass": _glass(mi, index),
        }
        for i, (right, down) in enumerate(lamp_positions):
            # Straight lines through the centre of the iris.
            position = (
                np.array([right * WIDTH / 2, down * HEIGHT / 2]) * PITCH / (screen + THICK + IRIS) * LAMPS
            )
            lamp = [float(position[0]), float(-position[1]), -LAMPS]
            reach = math.degrees(math.atan(1.15 * OPENING / LAMPS))
            scene[f"lamp{i}"] = {
                "type": "spot",
                "cutoff_angle": reach,
                "beam_width": reach,
                "intensity": {"type": "rgb", "value": 1e6 * (1 - 0.05 * i)},
                "to_world": mi.ScalarTransform4f().look_at(origin=lamp, target=[0, 0, 0], up=[0, 1, 0]),
            }
        # Orientation of a camera picture: the image on a screen is rotated by 180 degrees and viewed from
        # behind.
        rendered = np.array(mi.render(mi.load_dict(scene)))[..., 0]
        layers.append(rendered[:, ::-1])
    stacked = np.stack(layers, -1).astype(float)
    return 0.02 + stacked * (0.7 / np.quantile(stacked[stacked > 0.2 * stacked.max()], 0.5))


def _blades(count: int, rotation: float) -> np.ndarray:
    """Return the corners of straight blades in the circle, (count, 2); rotation 0 has a side on the left."""
    angle = math.pi + math.pi / count + math.radians(rotation) + 2 * math.pi * np.arange(count) / count
    return OPENING * np.stack([np.cos(angle), np.sin(angle)], -1)


def _circle(radius: float, count: int = 720) -> np.ndarray:
    angle = 2 * math.pi * np.arange(count) / count
    return radius * np.stack([np.cos(angle), np.sin(angle)], -1)


def _plate(mi: Any, hole: np.ndarray, z: float, bsdf: dict[str, Any]) -> Any:
    """Return a large plate with a star-shaped hole, corners (N, 2)."""
    inner = np.concatenate([hole, np.full((len(hole), 1), z)], -1)
    outer = np.concatenate([hole / np.linalg.norm(hole, axis=-1, keepdims=True) * 400, inner[:, 2:]], -1)
    count = len(hole)
    first = np.arange(count)
    after = (first + 1) % count
    faces = np.concatenate(
        [np.stack([first, after, after + count], -1), np.stack([first, after + count, first + count], -1)]
    )
    return _mesh(mi, np.concatenate([inner, outer]), faces, None, bsdf)


def _glass(mi: Any, index: float, rings: int = 160, around: int = 240) -> Any:
    """Return both sides of the lens and its edge, with the normals of the spheres."""
    height = WIDE * np.arange(1, rings + 1) / rings
    angle = 2 * math.pi * np.arange(around) / around
    points, normals, faces = [], [], []
    first = 0
    for vertex, side in ((IRIS, 1), (IRIS + THICK, -1)):
        sag = side * (CURVE - np.sqrt(CURVE**2 - height**2))
        ring = np.stack(
            [
                height[:, None] * np.cos(angle),
                height[:, None] * np.sin(angle),
                np.repeat((vertex + sag)[:, None], around, 1),
            ],
            -1,
        )
        vertices = np.concatenate([[[0.0, 0.0, vertex]], ring.reshape(-1, 3)])
        centre = np.array([0.0, 0.0, vertex + side * CURVE])
        points.append(vertices)
        normals.append((vertices - centre) / CURVE)
        index_around = np.arange(around)
        after = (index_around + 1) % around
        face_blocks = [np.stack([0 * index_around, 1 + after, 1 + index_around], -1)]
        for k in range(rings - 1):
            low, high = 1 + k * around, 1 + (k + 1) * around
            face_blocks += [
                np.stack([low + index_around, low + after, high + after], -1),
                np.stack([low + index_around, high + after, high + index_around], -1),
            ]
        side_faces = np.concatenate(face_blocks)
        faces.append(first + (side_faces if side > 0 else side_faces[:, ::-1]))
        first += len(vertices)
    bsdf = {"type": "dielectric", "int_ior": index, "ext_ior": 1.0}
    return _mesh(mi, np.concatenate(points), np.concatenate(faces), np.concatenate(normals), bsdf)


def _mesh(mi: Any, points: np.ndarray, faces: np.ndarray, normals: np.ndarray | None, bsdf: Any) -> Any:
    """Return a Mitsuba mesh, created through a PLY file."""
    columns = points if normals is None else np.concatenate([points, normals], -1)
    names = ["x", "y", "z"] + ([] if normals is None else ["nx", "ny", "nz"])
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    head += [f"property float {name}" for name in names]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    rows = np.zeros(len(faces), np.dtype([("count", "u1"), ("corner", "<i4", 3)]))
    rows["count"], rows["corner"] = 3, faces
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.ply"
        path.write_bytes("\n".join(head).encode() + columns.astype("<f4").tobytes() + rows.tobytes())
        return mi.load_dict(
            {"type": "ply", "filename": str(path), "face_normals": normals is None, "bsdf": bsdf}
        )


if __name__ == "__main__":
    main()

"""Measurements of BokehLab (thesis 001, chapter 5): ``python -m benchmarks.experiments.theses.bokehlab``.

5.1, figure 5.3: time of views, of image-based rays and of the engine ``rays`` over the triangles of the
scene; ``python -m benchmarks.plots`` plots it. Figure 5.4: time over the surfaces of a lens. 5.3: error of a
lens ray transfer table over its resolution. 5.4, figure 5.6: precision of the accumulator. 5.5, figure 5.8:
hybrid spreading of 6 megapixels. ``--figures DIR`` writes all as JSON files.
"""

import argparse
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.experiments.edges.level_of_detail import ball
from benchmarks.figures import write_figures
from benchmarks.measurement import processor_seconds
from bokehnet.baselines import hybrid_spreading
from bokehnet.baselines.rays.image_based_rays import image_rays
from bokehnet.baselines.rays.mesh_views import MeshObject, Picture, draw, render_views
from bokehnet.classical.rays_renderer import rays
from bokehnet.lenses import ThinLens
from bokehnet.lenses.catalog import catalog_names, load_lens
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.optics.sampling import disc_from_square, halton

_COMMAND = "python -m benchmarks.experiments.theses.bokehlab --figures docs/figures"

_PICTURE = Picture(width=300, height=200, pixel_pitch=36 / 300)
_LENS = ThinLens(focal_length=50.0, f_number=1.4, focus_distance=1500.0)
_SAMPLES = 64

# Numbers of objects of 131,072 triangles each, and cells along an axis of a table.
_OBJECTS, _CELLS = (1, 2, 4, 8, 16), (8, 16, 32, 64)


def _scene(count: int) -> list[MeshObject]:
    depths = np.geomspace(700, 4000, count)
    return [
        ball((0.12 * z * (-1) ** k, 0.03 * z * k / count, float(z)), 0.1 * z, k) for k, z in enumerate(depths)
    ]


def triangles() -> dict[str, dict[str, float]]:
    """Return processor seconds of 64 views, and of one view with rays through it, by scene."""
    rows = {}
    for count in _OBJECTS:
        objects = _scene(count)
        number = sum(len(mesh.levels[0][2]) for mesh in objects)
        rows[f"{number:,} triangles"] = {
            "views": processor_seconds(partial(render_views, objects, _LENS, _PICTURE, _SAMPLES)),
            "once": processor_seconds(partial(_one_view, objects)),
            "rays": processor_seconds(partial(_rays_through_view, objects)),
            "engine": processor_seconds(partial(_engine_on_view, objects)),
        }
    return rows


def _one_view(objects: list[MeshObject]) -> tuple[np.ndarray, np.ndarray]:
    """Return light (H, W, 3) and inverse depth (H, W), 1/mm, from the middle of the pupil."""
    light = np.zeros((_PICTURE.height, _PICTURE.width, 3), np.float32)
    inverse = np.zeros(light.shape[:2], np.float32)
    scale = _LENS.sensor_distance / _PICTURE.pixel_pitch
    for mesh in objects:
        draw(*mesh.levels[0], scale, _PICTURE.width / 2, _PICTURE.height / 2, 0.0, 0.0, light, inverse)
    return light, inverse


def _view_with_defocus(objects: list[MeshObject]) -> tuple[np.ndarray, np.ndarray]:
    """Return one view and its signed blur radius in pixels, (H, W)."""
    light, inverse = _one_view(objects)
    return light, np.asarray(_LENS.coc_radius(inverse.astype(float)) / _PICTURE.pixel_pitch, np.float32)


def _rays_through_view(objects: list[MeshObject]) -> None:
    image_rays(*_view_with_defocus(objects), samples=_SAMPLES)


def _engine_on_view(objects: list[MeshObject]) -> None:
    rays(*_view_with_defocus(objects))


def _points(count: int) -> np.ndarray:
    return disc_from_square(np.stack([halton(count, 2), halton(count, 3)], -1))


def surfaces() -> dict[str, dict[str, float]]:
    """Return processor seconds of a million rays by lens, in order of its surfaces."""
    rows = {}
    count = 200_000
    sensor, pupil = np.tile([5.0, 3.0], (count, 1)), _points(count)
    for name in sorted(catalog_names(mirrors=False), key=lambda each: len(load_lens(each).surfaces)):
        lens = load_lens(name)
        lens.sample_rays(sensor[:10], pupil[:10])
        seconds = processor_seconds(partial(lens.sample_rays, sensor, pupil)) * 1e6 / count
        passing = float((np.asarray(lens.sample_rays(sensor, pupil).weight) > 0).mean())
        rows[name] = {"surfaces": len(lens.surfaces), "seconds": seconds, "pass": 100 * passing}
    return rows


def _through(lens: PrescriptionLens, height: np.ndarray, pupil: np.ndarray) -> np.ndarray:
    """Return slope and origin of the rays from sensor heights through pupil points, (N, 4)."""
    sensor = np.stack([height, np.zeros_like(height)], -1)
    rays = lens.sample_rays(sensor, pupil)
    return np.concatenate([rays.slope, rays.origin], -1)


def transfer() -> dict[str, dict[str, float]]:
    """Return the error of tables over sensor height and pupil, by cells along an axis, for the double Gauss.

    The lens is symmetric, so that a sensor point is a height and a ray has three coordinates. ``spherical``
    uses a radius and an angle in the pupil, as the thesis uses spherical coordinates; ``square`` the
    equal-area map of a square to the disc, which has no pole.
    """
    lens = load_lens("double_gauss")
    focal, pitch = lens.focal_length, 36 / 450
    rng = np.random.default_rng(0)
    height, square = 18 * rng.random(20_000), rng.random((20_000, 2))
    pupil = 0.7 * disc_from_square(square)
    truth = _through(lens, height, pupil)
    rows = {}
    for cells in _CELLS:
        row = {}
        for kind in ("spherical", "square"):
            axis = np.linspace(0, 1, cells)
            grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
            table = _through(lens, 18 * grid[:, 0], 0.7 * _in_disc(grid[:, 1:], kind)).reshape(
                cells, cells, cells, 4
            )
            at = np.concatenate([height[:, None] / 18, _to_unit(pupil / 0.7, kind)], -1)
            error = _interpolated(table, at) - truth
            # Error at 3 m on the sensor's scale, pixels of 450 across.
            lateral = (error[:, :2] * 3000 + error[:, 2:]) / 3000 * focal / pitch
            row[kind] = float(np.sqrt((lateral**2).sum(-1).mean()))
            centre = np.hypot(*pupil.T) < 0.1
            row[f"{kind}_centre"] = float(np.sqrt((lateral[centre] ** 2).sum(-1).mean()))
        rows[f"{cells}^3"] = row
    return rows


def _in_disc(unit: np.ndarray, kind: str) -> np.ndarray:
    if kind == "square":
        return 2 * unit - 1
    angle = 2 * np.pi * unit[:, 1]
    return unit[:, :1] * np.stack([np.cos(angle), np.sin(angle)], -1)


def _to_unit(pupil: np.ndarray, kind: str) -> np.ndarray:
    if kind == "square":
        return (pupil + 1) / 2
    angle = np.arctan2(pupil[:, 1], pupil[:, 0]) / (2 * np.pi) % 1
    return np.stack([np.hypot(*pupil.T), angle], -1)


def _interpolated(table: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return trilinear look-ups at positions (N, 3) in the unit cube."""
    place = np.clip(at, 0, 1) * (len(table) - 1)
    low = np.minimum(place.astype(int), len(table) - 2)
    part = place - low
    total = np.zeros((len(at), table.shape[-1]))
    for corner in range(8):
        step = np.array([corner & 1, corner >> 1 & 1, corner >> 2])
        weight = np.where(step, part, 1 - part).prod(-1)
        total += weight[:, None] * table[tuple((low + step).T)]
    return total


def accumulators() -> dict[str, dict[str, float]]:
    """Return error and darkening of 1024 accumulated views by number format, with a lamp of brightness 30."""
    rng = np.random.default_rng(1)
    views, pixels = 1024, 4096
    light = rng.gamma(2.0, 0.15, (views, pixels))
    light[rng.random((views, pixels)) < 0.01] += 30.0
    truth = light.mean(0)
    rows = {}
    for name in ("12-bit integers", "16-bit floats", "32-bit floats"):
        if name == "12-bit integers":
            # Each view is scaled by 1/1024 before it is added, and clipped at 1, as the accumulation buffer
            # does.
            total = np.zeros(pixels)
            for view in light:
                total = np.minimum(total + np.floor(view / views * 4095 + 0.5) / 4095, 1.0)
            result = total
        else:
            kind = np.float16 if name.startswith("16") else np.float32
            sums = np.zeros(pixels, kind)
            for view in light:
                sums = sums + view.astype(kind)
            result = sums.astype(float) / views
        error = result - truth
        rows[name] = {
            "rms": float(np.sqrt((error**2).mean()) / truth.mean() * 100),
            "light": float(error.mean() / truth.mean() * 100),
        }
    return rows


def hybrid() -> dict[str, dict[str, float]]:
    """Return processor seconds of hybrid spreading at 3000 x 2000 pixels, and the fraction of outlines."""
    from bokehnet.baselines.spread.spreading import local_contrast

    rng = np.random.default_rng(2)
    small = rng.random((20, 30, 3)).astype(np.float32)
    image = np.repeat(np.repeat(small, 100, 0), 100, 1)
    image[::97, ::89] = 8.0
    depth = np.linspace(1, 4, 3000)[None] * np.ones((2000, 1))
    hybrid_spreading(image[:60, :60], np.full((60, 60), 3.0, np.float32))
    rows = {}
    for name, focus in (("front focus", 1.2), ("back focus", 3.6)):
        defocus = (60 * (1 / depth - 1 / focus)).astype(np.float32)
        rows[name] = {
            "seconds": processor_seconds(partial(hybrid_spreading, image, defocus)),
            "outlines": float((local_contrast(image, 4) > 0.02).mean()) * 100,
            "largest": float(np.abs(defocus).max()),
        }
    return rows


# Measurements: function, title of the row, conditions and columns with their titles and formats.
_MEASUREMENTS = {
    "bokehlab_triangles": (
        triangles,
        f"{_PICTURE.width}x{_PICTURE.height} pixels, {_SAMPLES} samples, processor seconds, medians of 3",
        {
            "views": ("64 views", ".2f"),
            "once": ("one view", ".3f"),
            "rays": ("one view and 64 rays a pixel", ".2f"),
            "engine": ("one view and engine `rays`", ".2f"),
        },
    ),
    "bokehlab_surfaces": (
        surfaces,
        "lenses of the catalog, wide open; processor seconds a million rays, medians of 3",
        {
            "surfaces": ("surfaces", ".0f"),
            "seconds": ("seconds", ".2f"),
            "pass": ("rays that pass, %", ".0f"),
        },
    ),
    "bokehlab_transfer": (
        transfer,
        "double Gauss; RMS error of a ray at 3 m, pixels of a picture 450 wide",
        {
            "spherical": ("radius and angle", ".3f"),
            "spherical_centre": ("its centre", ".3f"),
            "square": ("square", ".3f"),
            "square_centre": ("its centre", ".3f"),
        },
    ),
    "bokehlab_accumulators": (
        accumulators,
        "1024 views, lamps of brightness 30; per cent of the mean light",
        {"rms": ("RMS error, %", ".3f"), "light": ("change of light, %", ".3f")},
    ),
    "bokehlab_hybrid": (
        hybrid,
        "3000x2000 pixels; processor seconds, medians of 3",
        {
            "seconds": ("seconds", ".1f"),
            "outlines": ("outlines, %", ".0f"),
            "largest": ("largest radius, px", ".0f"),
        },
    ),
}


def report(
    measurements: Mapping[str, tuple], command: str, description: str | None, names: list[str] | None = None
) -> None:
    """Run measurements and print them; with ``--figures`` write them, too."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--figures", type=Path, help="folder of the JSON files")
    parser.add_argument("--only", nargs="+", choices=measurements, help="default: all")
    arguments = parser.parse_args(names)
    for name in arguments.only or measurements:
        measure, conditions, columns = measurements[name]
        rows = measure()
        print(f"\n{name}: {conditions}")
        for label, row in rows.items():
            cells = [f"{title} {format(row[key], form)}" for key, (title, form) in columns.items()]
            print(f"  {label:28s} " + "  ".join(cells), flush=True)
        if arguments.figures:
            write_figures(arguments.figures / f"{name}.json", command, conditions, columns, rows)


def main() -> None:
    """Entry of the command line."""
    report(_MEASUREMENTS, _COMMAND, __doc__)


if __name__ == "__main__":
    main()

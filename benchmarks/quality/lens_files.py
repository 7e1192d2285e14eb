"""Lens files of other programs: ``python -m benchmarks.quality.lens_files FOLDER [--glasses FOLDER]``.

Reads each file of the folder and compares focal length, f-number and spot sizes with those of optiland and
ray-optics, where installed, for the same file. Their lengths are in the unit of the file, ours in mm. Spots
are root mean square distances from the centre of one bundle, over 6 rings of rays in the paraxial entrance
pupil, for an object on the axis and at 0.7 of the maximum angle, in the image plane of the file.
"""

import argparse
import contextlib
import io
import logging
import math
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bokehnet.errors import BokehnetError
from bokehnet.lenses.files.reading import LENS_FILES, import_lens
from bokehnet.lenses.pupils.paraxial_lens import paraxial_lens
from bokehnet.lenses.surface_trace import beam_between, trace

__all__ = ["main"]

_RINGS = 6
_FIELD = 0.7
# Size below which a spot is a point, as a fraction of the focal length.
_POINT_SIZE = 1e-8
_TOLERANCES = (1e-6, 1e-6, 1e-4, 1e-4)

_Four = tuple[float, float, float, float]
"""Focal length, f-number, spots on the axis and off it; NaN where unknown."""


def _pupil() -> np.ndarray:
    """Return rings of rays in the unit disc, (rays, 2), the outermost at 0.9."""
    radii = np.repeat(0.9 * (np.arange(_RINGS) + 1) / _RINGS, 6 * (np.arange(_RINGS) + 1))
    turns = np.concatenate([np.arange(6 * k) / (6 * k) for k in range(1, _RINGS + 1)]) * 2 * np.pi
    return np.stack([radii * np.cos(turns), radii * np.sin(turns)], -1)


def _size(x: np.ndarray, y: np.ndarray) -> float:
    x, y = x - x.mean(), y - y.mean()
    return float(np.sqrt((x * x + y * y).mean()))


def _ours(path: Path, glasses: list[Path]) -> tuple[_Four, float]:
    """Return the four numbers, and the unit of the file in mm."""
    read = import_lens(path, glasses)
    prescription = read.prescription
    surfaces = prescription.trace_surfaces(prescription.design_wavelength)
    gauss = paraxial_lens(surfaces)
    focal_length = float(gauss.cardinal.focal_length)
    sizes = [math.nan, math.nan]
    if math.isinf(read.object_distance):
        image = surfaces[-1].vertex + prescription.surfaces[-1].thickness
        pupil = abs(float(gauss.entrance.radius)) * _pupil()
        angle = math.atan(prescription.image_radius / prescription.focal_length)
        before = min(0.0, float(gauss.entrance.position)) - 1.0
        for number, fraction in enumerate((0.0, _FIELD)):
            slope = math.tan(fraction * angle)
            ends = [
                (pupil[:, 0], pupil[:, 1] + (t - gauss.entrance.position) * slope, t)
                for t in (before - 1.0, before)
            ]
            beam = trace(surfaces, beam_between(*ends))
            comparable = fraction == 0 or read.field_is_angle
            if comparable and np.isfinite(beam.fill).all() and beam.fill.max() < 1e5:
                size = _size(*beam.at(image))
                sizes[number] = size if size > _POINT_SIZE * abs(focal_length) else math.nan
    f_number = abs(focal_length / gauss.entrance.radius / 2)
    return (focal_length, f_number, sizes[0], sizes[1]), read.millimetres


def _optiland(path: Path) -> _Four:
    from optiland import fileio  # type: ignore[import-not-found]

    readers = {".json": "load_optiland_file", ".zmx": "load_zemax_file", ".seq": "load_codev_file"}
    lens: Any = getattr(fileio, readers[path.suffix.lower()])(str(path))
    pupil, sizes = _pupil(), []
    ones = np.ones(len(pupil))
    for fraction in (0.0, _FIELD):
        with contextlib.suppress(Exception):
            lens.trace_generic(0 * ones, fraction * ones, pupil[:, 0], pupil[:, 1], lens.primary_wavelength)
            x, y = (np.asarray(at)[-1] for at in (lens.surfaces.x, lens.surfaces.y))
            sizes.append(_size(x, y))
    sizes += [math.nan] * (2 - len(sizes))
    focal_length = float(lens.paraxial.f2())
    return focal_length, abs(focal_length / float(lens.paraxial.EPD())), sizes[0], sizes[1]


def _rayoptics(path: Path) -> _Four:
    if path.suffix.lower() == ".json":
        raise KeyError(path.suffix)
    from rayoptics.gui.appcmds import open_model  # type: ignore[import-not-found]
    from rayoptics.raytr import raytrace  # type: ignore[import-not-found]

    model: Any = open_model(str(path))
    data = model["analysis_results"]["parax_data"].fod
    sequence, spec = model.seq_model, model.optical_spec
    wavelength = spec.spectral_region.central_wvl
    sizes = []
    largest = math.radians(max((math.hypot(f.x, f.y) for f in spec.field_of_view.fields), default=0.0))
    scale = getattr(spec.field_of_view, "value", 1.0) if spec.field_of_view.is_relative else 1.0
    for fraction in (0.0, _FIELD):
        with contextlib.suppress(Exception):
            angle = fraction * largest * scale
            direction = np.array([0.0, math.sin(angle), math.cos(angle)])
            path_of = list(sequence.path(wl=wavelength, start=1))
            # Rays start in front of the plane of the first surface.
            start = [
                np.array([x, y - data.enp_dist * math.tan(angle), 0.0]) - 2 * direction / direction[2]
                for x, y in _pupil() * data.enp_radius
            ]
            dummy = next(iter(sequence.path(wl=wavelength)))
            at_origin = (dummy[0], dummy[1], (np.eye(3), np.array([0.0, 0.0, 0.0])), dummy[3], dummy[4])
            ends = [
                raytrace.trace_raw(iter([at_origin, *path_of]), point, direction, wavelength)[0][-1][0]
                for point in start
            ]
            sizes.append(_size(*np.array(ends)[:, :2].T))
    sizes += [math.nan] * (2 - len(sizes))
    return float(data.efl), abs(float(data.efl / data.enp_radius / 2)), sizes[0], sizes[1]


def _against(tool: Callable[[Path], _Four], path: Path, own: _Four, unit: float) -> tuple[str, list[float]]:
    """Return the deviation of a tool from our numbers as text and values; NaN where either has none."""
    output = io.StringIO()
    try:
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
            reference = tool(path)
    except Exception as error:  # other programs raise exceptions of any type
        return f"- ({type(error).__name__})", [math.nan] * 4
    # A mirror reverses the axis and thus the sign of their focal length.
    units = (unit, 1.0, unit, unit)
    deviations = [
        abs(abs(a * scale) / abs(b) - 1) if b else math.nan
        for a, b, scale in zip(reference, own, units, strict=True)
    ]
    return ", ".join(
        "-" if math.isnan(deviation) else f"{deviation:.0e}" for deviation in deviations
    ), deviations


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--glasses", type=Path, action="append", default=[])
    arguments = parser.parse_args()
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    paths = [path for path in sorted(arguments.folder.iterdir()) if path.suffix.lower() in LENS_FILES]
    print("Off by: of focal length, f-number, spot on the axis and off it")
    print("| file | focal length | f-number | optiland: off by | ray-optics: off by |")
    print("|---|---|---|---|---|")
    read, agreed, compared = 0, np.zeros(4, int), np.zeros(4, int)
    for path in paths:
        try:
            result, unit = _ours(path, arguments.glasses)
        except BokehnetError as error:
            print(f"| {path.name} | {str(error).replace(str(path), '').strip(', :')} | | | |")
            continue
        read += 1
        cells, tool_deviations = zip(
            *(_against(tool, path, result, unit) for tool in (_optiland, _rayoptics)), strict=True
        )
        nearest = np.fmin(*np.array(tool_deviations))
        compared += ~np.isnan(nearest)
        agreed += nearest <= _TOLERANCES
        print(f"| {path.name} | {result[0]:.6f} | {result[1]:.5f} | {' | '.join(cells)} |", flush=True)
    print(f"{read} of {len(paths)} files are read")
    for name, limit, count, total in zip(
        ("focal length", "f-number", "spot on the axis", "spot off it"),
        _TOLERANCES,
        agreed,
        compared,
        strict=True,
    ):
        print(f"{name}: {count} of {total} as the nearer program says, to {limit:g}")


if __name__ == "__main__":
    main()

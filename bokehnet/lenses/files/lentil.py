"""Lens tables of polynomial optics, ``.fx``, as used by lentil and pota.

A row per surface: radius, thickness to the next, material, its index and Abbe number unless it is air or the
iris, and half of the clear aperture. A thickness of several numbers separated by ``/`` has one for each
position of a zoom; a comment ``#!aspheric=`` contains the conic constant, then the coefficients of the powers
4, 6, ... of the height.

Source: the tables that come with lentil (zpelgrims/lentil, ``polynomial-optics/lenses``).
"""

import math
import re
from pathlib import Path

from bokehnet.lenses.files.glass.glasses import GlassCatalogues, approximate
from bokehnet.lenses.files.structure import FileLens, FilePosition, FileSurface, fail
from bokehnet.lenses.files.text import number, read_lines

__all__ = ["read_lentil"]

# Radius, in the unit of the file, from which on a surface is a plane.
_MIN_PLANE_RADIUS = 1e5


def read_lentil(path: Path, catalogues: GlassCatalogues) -> FileLens:
    """Read a table of radii, distances and glasses, in mm; glasses are those of their index and Abbe number.

    Raises:
        LensError: The file is not a table, a number is invalid, or a surface is a cylinder.
    """
    lens = FileLens(path=path, name=path.stem, surfaces=[FileSurface(thickness=math.inf)])
    moving: dict[int, list[float]] = {}
    for line, text in enumerate(read_lines(path), start=1):
        row, _, remark = (part.strip() for part in text.replace("//", "#", 1).partition("#"))
        if match := re.match(r"FOV\s+([-+.\deE]+)", remark):
            lens.field = ("angle", number(match[1]) / 2)
        if row:
            try:
                surface, thicknesses = _row(path, line, row.split(), remark)
            except (ValueError, IndexError) as error:
                fail(path, line, "row", f"expected radius, thickness, material, got {row[:60]!r} ({error})")
            if len(thicknesses) > 1:
                moving[len(lens.surfaces)] = thicknesses
            lens.surfaces.append(surface)
    if len(lens.surfaces) < 3:
        fail(path, 0, "row", "expected two surfaces or more, got none; is this a table of lentil?")
    lens.surfaces.append(FileSurface())
    count = max(map(len, moving.values()), default=0)
    if any(len(numbers) != count for numbers in moving.values()):
        fail(path, 0, "thickness", f"expected as many positions in each row that moves, {count}, got fewer")
    lens.positions = [
        FilePosition(thickness={row: numbers[i] for row, numbers in moving.items()}) for i in range(count)
    ]
    lens.aperture = ("stop", 0.0)
    return lens


def _row(path: Path, line: int, words: list[str], remark: str) -> tuple[FileSurface, list[float]]:
    """Return the surface, and its thickness in each position."""
    radius, thicknesses, material = number(words[0]), [number(word) for word in words[1].split("/")], words[2]
    if material.startswith(("cx_", "cy_")):
        fail(path, line, material, "expected surfaces of revolution, got a cylinder")
    stop, kind = material.lower() == "iris", material.lower()
    glass = kind not in ("air", "iris", "vacuum")
    aspheric = re.search(r"!aspheric=\s*([-+.,\deE\s]+)", remark)
    powers = [number(word) for word in aspheric[1].split(",")] if aspheric else [0.0]
    surface = FileSurface(
        line=line,
        radius=math.inf if stop or abs(radius) >= _MIN_PLANE_RADIUS or radius == 0 else radius,
        thickness=thicknesses[0],
        medium=approximate(number(words[3]), number(words[4])) if glass else None,
        conic=powers[0],
        aspheric=(0.0, *powers[1:]) if any(powers[1:]) else (),
        semi_diameter=number(words[-1]),
        stop=stop,
        comment=material if glass and kind != "abbe" else "",
    )
    return surface, thicknesses

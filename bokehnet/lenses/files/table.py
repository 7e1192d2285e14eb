"""Patent table, ``.csv``: R, d, n, V, one row per surface.

The first row that is not a comment names the columns: R (radius; 0, inf or empty is a plane), d (to the
next), n (index at the d line; empty or 1 is air), V (Abbe number), and optionally D (diameter of the clear
aperture), K (conic constant) and A4, A6, ... (powers of the height). The row of the stop has ``stop`` instead
of a radius, and that of a mirror has ``mirror`` instead of an index. Comments contain other values::

    # name = Petzval
    # f_number = 2.0
    # field = 8
    R, d, n, V
"""

import csv
import math
from pathlib import Path

from bokehnet.lenses.files.glass.glasses import GlassCatalogues, approximate
from bokehnet.lenses.files.structure import FileLens, FileSurface, fail
from bokehnet.lenses.files.text import number, read_lines

__all__ = ["read_table"]

_COLUMNS = {"R", "D", "N", "V", "DIAMETER", "K", "GLASS"}


def read_table(path: Path, catalogues: GlassCatalogues) -> FileLens:
    """Read a table of radii, distances, indices and Abbe numbers, in mm.

    Raises:
        LensError: The file is not such a table, or a number is invalid.
    """
    lens = FileLens(path=path, surfaces=[FileSurface(thickness=math.inf)])
    names: list[str] = []
    for line, text in enumerate(read_lines(path), start=1):
        stripped = text.strip()
        if stripped.startswith("#"):
            _remark(lens, line, stripped.lstrip("# "))
        elif stripped and not names:
            names = _columns(path, line, stripped)
        elif stripped:
            cells = dict(zip(names, (cell.strip() for cell in next(csv.reader([stripped]))), strict=False))
            lens.surfaces.append(_row(path, line, cells, catalogues))
            if lens.surfaces[-1].mirror:
                lens.surfaces[-1].medium = lens.surfaces[-2].medium
    if len(lens.surfaces) < 3:
        fail(path, 0, "R", "expected a header with R, d, n, V and two surfaces or more, got none")
    lens.surfaces.append(FileSurface())
    return lens


def _columns(path: Path, line: int, text: str) -> list[str]:
    names = [cell.strip() for cell in next(csv.reader([text]))]
    keys = ["DIAMETER" if name == "D" else name.upper() for name in names]
    for name, label in (("R", "R"), ("D", "d"), ("N", "n")):
        if name not in keys:
            fail(path, line, label, f"expected a column {label}, got {', '.join(names)[:60]}")
    for name, key in zip(names, keys, strict=True):
        if key not in _COLUMNS and not (key.startswith("A") and key[1:].isdigit()):
            fail(path, line, name, "expected R, d, n, V, D, K or A4, A6, ...")
    return keys


def _remark(lens: FileLens, line: int, text: str) -> None:
    key, mark, value = (part.strip() for part in text.partition("="))
    if not mark:
        return
    try:
        if key == "name":
            lens.name = value
        elif key in ("f_number", "epd"):
            lens.aperture = (key, number(value))
        elif key == "field":
            lens.field = ("angle", number(value))
        elif key == "image_radius":
            lens.field = ("image", number(value))
        elif key == "wavelength":
            lens.wavelength = number(value)
    except ValueError:
        fail(lens.path, line, key, f"expected a number, got {value[:40]!r}")


def _row(path: Path, line: int, cells: dict[str, str], catalogues: GlassCatalogues) -> FileSurface:
    def value(key: str, default: float) -> float:
        text = cells.get(key, "")
        try:
            return number(text) if text else default
        except ValueError:
            fail(path, line, key, f"expected a number, got {text[:40]!r}")

    stop, mirror = cells.get("R", "").lower() == "stop", cells.get("N", "").lower() == "mirror"
    cells = {**cells, "N": ""} if mirror else cells
    radius = math.inf if stop else value("R", math.inf)
    index, abbe, glass = value("N", 1.0), value("V", 0.0), cells.get("GLASS", "")
    powers = {int(key[1:]): value(key, 0.0) for key in cells if key.startswith("A")}
    aspheric = tuple(powers.get(2 * i, 0.0) for i in range(1, max(powers, default=0) // 2 + 1))
    medium = catalogues.find(glass) if glass else None
    if medium is None and index > 1:
        medium = approximate(index, abbe)
    return FileSurface(
        line=line,
        radius=radius if radius else math.inf,
        thickness=value("D", 0.0),
        medium=medium,
        conic=value("K", 0.0),
        aspheric=aspheric if any(aspheric) else (),
        semi_diameter=value("DIAMETER", 0.0) / 2 or None,
        stop=stop,
        mirror=mirror,
    )

"""Text table of aberrations: a row per wavelength, a column per aberration.

::

    # name = Double Gauss
    # rim = 0.557, 1.011
    wavelength, spherical, coma, astigmatism, field_curvature, distortion, axial, lateral
    486.1, -0.41, 0.12, 0.5, -0.3, 0, 0.04, -0.02
    587.6, -0.42, 0.12, 0.5, -0.3, 0, 0, 0
    656.3, -0.43, 0.12, 0.5, -0.3, 0, -0.02, 0.01

Values are percent of the half-diagonal of the picture, at the rim of the pupil and in the corner of the
picture. Columns, in any order, each at most once; missing columns are 0:

- the coefficients B, F, C, D, E of Seidel's five aberrations (:class:`SeidelCoefficients`), ``axial``: the
  blur of a wavelength in the plane of focus, and ``lateral``: the reduction of its image size;
- ``zernike_N``: the aberration whose wavefront in the corner is polynomial N of Noll, in units in which the
  transverse aberration is its gradient over the pupil. It grows with the field by the lowest power that
  symmetry allows: 0 for defocus and spherical aberration, 1 for coma, 2 for astigmatism;
- ``image_f_IJK`` and ``image_g_IJK``: a single term of :class:`AberrationMap`, ``a`` and ``h`` times
  ``(a.a)^I (a.h)^J (h.h)^K``; ``pupil_f_IJK`` and ``pupil_g_IJK`` are terms of the pupil, percent of its
  radius.

Comments ``rim`` contain shift and radius of a vignetting aperture, one line each; a radius below 0
is that of a central obstruction.
"""

import csv
import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bokehnet.errors import ConfigError
from bokehnet.optics.aberrations.aberration_map import TERMS, AberrationMap, term
from bokehnet.optics.aberrations.seidel import SeidelCoefficients
from bokehnet.optics.aberrations.zernike import noll_order, radial_factors

__all__ = ["aberration_table", "parse_aberration_table"]

_SEIDEL = ("spherical", "coma", "astigmatism", "field_curvature", "distortion")
_PARTS = tuple(f"{part}_{letter}_" for part in ("image", "pupil") for letter in "fg")
# Percent below which a term is omitted, and maximum number of rows.
_MIN_PERCENT, _MAX_ROWS = 1e-9, 10_000


def aberration_table(lens: AberrationMap, remarks: dict[str, str] | None = None) -> str:
    """Return the table of an aberration map; :func:`parse_aberration_table` reads it back.

    Third-order terms and axial and lateral colour use the named columns; the remainder uses single terms.

    Args:
        lens: Map to write; a tilt of the plane of focus is not a property of the lens and is omitted.
        remarks: Keys and values of comment lines at the top.
    """
    image, pupil = lens.transverse_aberration, lens.pupil_aberration
    seidel = SeidelCoefficients(
        spherical=image[:, 0, term(1, 0, 0)],
        coma=image[:, 1, term(1, 0, 0)],
        astigmatism=image[:, 1, term(0, 1, 0)] / 2,
        field_curvature=image[:, 0, term(0, 0, 1)],
        distortion=image[:, 1, term(0, 0, 1)],
    )
    columns = {name: getattr(seidel, name) for name in _SEIDEL}
    columns |= {"axial": image[:, 0, term(0, 0, 0)], "lateral": image[:, 1, term(0, 0, 0)]}
    rest = image - seidel.transverse_aberration()
    rest[:, :, term(0, 0, 0)] = 0.0
    for prefix, values in zip(_PARTS, (rest[:, 0], rest[:, 1], pupil[:, 0], pupil[:, 1]), strict=True):
        for number, (i, j, k) in enumerate(TERMS):
            if np.abs(values[:, number]).max() * 100 > _MIN_PERCENT:
                columns[f"{prefix}{i}{j}{k}"] = values[:, number]
    lines = [f"# {key} = {value}" for key, value in (remarks or {}).items()]
    lines += [f"# rim = {shift:.9g}, {radius:.9g}" for shift, radius in lens.vignetting_apertures]
    lines.append(",".join(["wavelength", *columns]))
    for number, wavelength in enumerate(lens.wavelengths):
        cells = [f"{100 * values[number]:.12g}" for values in columns.values()]
        lines.append(",".join([f"{wavelength:.9g}", *cells]))
    return "\n".join([*lines, ""])


def parse_aberration_table(text: str, path: str | Path) -> AberrationMap:
    """Return the aberration map of a table.

    Args:
        text: Contents of the file.
        path: Path of the file, for messages.

    Raises:
        ConfigError: A column is unknown or duplicated, a cell is not a finite number, or wavelengths
            are not ascending.
    """
    rims, rows, numbers = [], [], []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.lstrip().startswith("#"):
            key, _, value = line.lstrip("# ").partition("=")
            if key.strip() == "rim":
                rims.append(_rim(value, f"{path}: line {number}"))
        elif line.strip():
            rows.append([cell.strip() for cell in next(csv.reader([line]))])
            numbers.append(number)
        if len(rows) > _MAX_ROWS:
            raise ConfigError(f"{path}: expected {_MAX_ROWS} wavelengths at most, found more")
    if len(rows) < 2:
        raise ConfigError(f"{path}: expected names of columns and a row of numbers, found {len(rows)} rows")
    names, cells = rows[0], rows[1:]
    duplicates = [name for name, count in Counter(names).items() if count > 1]
    if duplicates or "wavelength" not in names:
        problem = f"{duplicates[0]!r} twice" if duplicates else "none"
        raise ConfigError(f"{path}: line {numbers[0]}: expected one column wavelength, found {problem}")
    columns = [_column(name, f"{path}: line {numbers[0]}") for name in names]
    values = np.array(
        [_numbers(row, names, f"{path}: line {n}") for row, n in zip(cells, numbers[1:], strict=True)]
    )
    wavelengths = values[:, names.index("wavelength")]
    if (np.diff(wavelengths) <= 0).any() or wavelengths[0] <= 0:
        raise ConfigError(f"{path}: wavelength: expected rising numbers above 0, got {wavelengths.tolist()}")
    tables = np.zeros((2, len(values), 2, len(TERMS)))
    for to_coefficients, percent in zip(columns, values.T, strict=True):
        tables += to_coefficients(percent / 100)
    return AberrationMap(
        wavelengths=wavelengths,
        transverse_aberration=tables[0],
        pupil_aberration=tables[1],
        vignetting_apertures=tuple(rims),
    )


def _rim(text: str, location: str) -> tuple[float, float]:
    try:
        shift, radius = map(float, text.split(","))
    except ValueError as error:
        raise ConfigError(f"{location}: rim: expected a shift and a radius, got {text.strip()!r}") from error
    if not math.isfinite(shift) or not 0 < abs(radius) < math.inf:
        raise ConfigError(
            f"{location}: rim: expected a finite shift and a radius other than 0, got {text.strip()!r}"
        )
    return shift, radius


# Largest magnitude of a cell: percent, or nm. A radius of the pupil is 100.
_MAX_NUMBER = 1e6


def _numbers(row: list[str], names: list[str], location: str) -> list[float]:
    if len(row) != len(names):
        raise ConfigError(f"{location}: expected {len(names)} numbers, found {len(row)}")
    result = []
    for name, cell in zip(names, row, strict=True):
        try:
            result.append(float(cell))
        except ValueError as error:
            raise ConfigError(f"{location}: {name}: expected a number, got {cell!r}") from error
        if not abs(result[-1]) <= _MAX_NUMBER:
            raise ConfigError(f"{location}: {name}: expected a number up to {_MAX_NUMBER:g}, got {cell!r}")
    return result


def _column(name: str, location: str) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function from fractions of a column (L,) to both sets of coefficients, (2, L, 2, 20)."""
    shape = np.zeros((2, 2, len(TERMS)))
    if name in _SEIDEL:
        shape[0] = SeidelCoefficients(**{name: 1.0}).transverse_aberration()
    elif name in ("axial", "lateral"):
        shape[0, int(name == "lateral"), term(0, 0, 0)] = 1.0
    elif name.startswith("zernike_"):
        shape[0] = _zernike_column(name, location)
    elif name.startswith(_PARTS):
        prefix = next(part for part in _PARTS if name.startswith(part))
        powers = tuple(int(digit) for digit in name[len(prefix) :] if digit.isdigit())
        if powers not in TERMS or len(name) != len(prefix) + 3:
            raise ConfigError(f"{location}: {name}: expected three powers with a sum of 3 at most")
        number = _PARTS.index(prefix)
        shape[number // 2, number % 2, TERMS.index(powers)] = 1.0
    elif name != "wavelength":
        known = ", ".join((*_SEIDEL, "axial", "lateral", "zernike_N", *(f"{part}IJK" for part in _PARTS)))
        raise ConfigError(f"{location}: expected columns wavelength, {known}, got {name!r}")
    return lambda column: shape[:, None] * column[:, None, None]


def _zernike_column(name: str, location: str) -> np.ndarray:
    """Return the gradient over the pupil of a polynomial with angles relative to the field, (2, 20).

    With p = a.a, q = a.h and z = h.h the cosine of m times the angle, times |a|^m |h|^m, is the Chebyshev
    polynomial of q, homogenised by p z; a gradient is ``2 dW/dp a + dW/dq h``.
    """
    text = name.removeprefix("zernike_")
    number = int(text) if text.isdigit() and len(text) < 4 else 0
    degree, order = noll_order(number) if number > 1 else (0, 0)
    if not number > 1 or order < 0 or degree > 8:
        raise ConfigError(
            f"{location}: {name}: expected a polynomial from 2 up, of degree 8 at most, that is symmetric "
            f"about the field's direction"
        )
    result = np.zeros((2, len(TERMS)))
    for power, radial in radial_factors(degree, order).items():
        for (p, q, z), factor in _cosine(order).items():
            p, factor = p + (power - order) // 2, factor * radial * _norm(degree, order)
            for row, powers, multiplier in ((0, (p - 1, q, z), 2 * p), (1, (p, q - 1, z), q)):
                if multiplier and powers not in TERMS:
                    raise ConfigError(
                        f"{location}: {name}: expected an aberration of the seventh order at most"
                    )
                if multiplier:
                    result[row, TERMS.index(powers)] += multiplier * factor
    return result


def _norm(degree: int, order: int) -> float:
    return math.sqrt((degree + 1) * (2 if order else 1))


def _cosine(order: int) -> dict[tuple[int, int, int], float]:
    """Return the powers of (p, q, z) and factors of ``cos(order angle) |a|^order |h|^order``.

    Recursion: T = 2 q T' - p z T''.
    """
    before, now = {(0, 0, 0): 1.0}, {(0, 1, 0): 1.0}
    if order == 0:
        return before
    for _ in range(order - 1):
        following: dict[tuple[int, int, int], float] = {}
        for (p, q, z), factor in now.items():
            following[p, q + 1, z] = following.get((p, q + 1, z), 0.0) + 2 * factor
        for (p, q, z), factor in before.items():
            following[p + 1, q, z + 1] = following.get((p + 1, q, z + 1), 0.0) - factor
        before, now = now, following
    return now

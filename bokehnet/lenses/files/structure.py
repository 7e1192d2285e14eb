"""Content of a lens file of any format, and its conversion to a prescription.

Rows go from the object to the image, both included. Formats leave different things open: the position of the
stop among curved surfaces, its size, and the sizes of the other surfaces. Gaussian optics completes them,
with a note.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from bokehnet.errors import LensError
from bokehnet.lenses.prescription_file import FocusRow, Prescription, SurfaceRow
from bokehnet.lenses.pupils.paraxial_lens import ParaxialLens, paraxial_lens
from bokehnet.optics.spectral.glass import D_LINE, Glass

__all__ = ["MAX_OBJECT_DISTANCE", "FileLens", "FilePosition", "FileSurface", "fail", "to_prescription"]

# Factor on the heights of paraxial rays to the corner for missing clear apertures, and maximum semi-diameter
# over radius of curvature.
_APERTURE_MARGIN, _MAX_HEIGHT_OVER_RADIUS = 1.05, 0.98
MAX_OBJECT_DISTANCE = 1e9  # mm; objects beyond are at infinity
_DEFAULT_FIELD_DEGREES = 10.0  # field of files without one


@dataclass(kw_only=True)
class FileSurface:
    """One row of a lens file, in its own unit of length.

    Attributes:
        line: First line of the row in the file, from 1.
        radius: Radius of curvature; infinite is a plane.
        thickness: Distance to the next row.
        medium: Medium behind the surface; None is air.
        conic: Conic constant.
        aspheric: Coefficients of the height to the powers 2, 4, 6, ...
        odd: Coefficients of the height to the powers 3, 5, 7, ...
        semi_diameter: Half of the clear aperture; None if not given.
        inner_radius: Radius below which rays are blocked.
        mirror: True for a mirror; files count distances against the light behind an odd number of mirrors.
        stop: True for the aperture stop.
        comment: Name of the surface in the file.
    """

    line: int = 0
    radius: float = math.inf
    thickness: float = 0.0
    medium: Glass | None = None
    conic: float = 0.0
    aspheric: tuple[float, ...] = ()
    odd: tuple[float, ...] = ()
    semi_diameter: float | None = None
    inner_radius: float = 0.0
    mirror: bool = False
    stop: bool = False
    comment: str = ""

    @property
    def is_plane(self) -> bool:
        """True if it is flat and not a mirror, so that it bends no light within one medium."""
        return math.isinf(self.radius) and not any((*self.aspheric, *self.odd)) and not self.mirror


@dataclass(kw_only=True)
class FilePosition:
    """One position of a zoom or of floating groups; missing values are those of the file.

    Attributes:
        thickness: Thickness by row number; 0 is the object distance.
        aperture: Value of the ``aperture`` of the lens.
    """

    thickness: dict[int, float] = dataclasses.field(default_factory=dict)
    aperture: float | None = None


@dataclass(kw_only=True)
class FileLens:
    """Content of a lens file.

    Attributes:
        path: Path of the file.
        name: Title.
        surfaces: Surfaces from the object to the image, both included.
        millimetres: Millimetres per unit of length of the file.
        aperture: ("epd", diameter), ("f_number", N) for an object at infinity, ("working_f_number", N) for
            the object of the file, ("object_na", sine), ("image_na", sine) or ("stop", 0.0): the clear
            aperture of the stop itself.
        field: ("angle", degrees) from the axis, ("image", height) or ("object", height); the largest.
        positions: Positions of a zoom or of floating groups; empty if nothing moves.
        wavelength: Wavelength of focus and pupils, nm.
        notes: Notes of the reader, a sentence each.
        skipped: Ignored commands without effect on the geometry, with their counts.
    """

    path: Path
    name: str = ""
    surfaces: list[FileSurface] = dataclasses.field(default_factory=list)
    millimetres: float = 1.0
    aperture: tuple[str, float] | None = None
    field: tuple[str, float] | None = None
    positions: list[FilePosition] = dataclasses.field(default_factory=list)
    wavelength: float = D_LINE
    notes: list[str] = dataclasses.field(default_factory=list)
    skipped: dict[str, int] = dataclasses.field(default_factory=dict)

    def skip(self, command: str) -> None:
        """Count an ignored command."""
        self.skipped[command] = self.skipped.get(command, 0) + 1

    def at(self, position: int) -> "FileLens":
        """Return the lens with its groups in a position, counted from 1.

        Raises:
            LensError: The position does not exist.
        """
        if not 1 <= position <= max(len(self.positions), 1):
            count = len(self.positions)
            fail(
                self.path,
                0,
                "position",
                f"expected 1 to {count}, got {position}"
                if count > 1
                else f"expected none, as nothing moves, got {position}",
            )
        if not self.positions:
            return self
        selected = self.positions[position - 1]
        surfaces = [
            replace(surface, thickness=selected.thickness.get(row, surface.thickness))
            for row, surface in enumerate(self.surfaces)
        ]
        aperture = self.aperture
        if aperture is not None and selected.aperture is not None:
            aperture = (aperture[0], selected.aperture)
        return replace(self, surfaces=surfaces, aperture=aperture, notes=list(self.notes))


def fail(path: Path, line: int, key: str, problem: str) -> NoReturn:
    """Raise a ``LensError`` that names file, line and key."""
    raise LensError(f"{path}, line {line}: {key}: {problem}" if line else f"{path}: {key}: {problem}")


def to_prescription(lens: FileLens) -> Prescription:
    """Return the prescription of a lens file, in mm.

    Positions that differ in the object distance become the floating positions for these focus distances.

    Raises:
        LensError: There are too few surfaces, the lens does not focus, or a row is invalid.
    """
    path = lens.path
    surface_count = len(lens.surfaces) - 2
    if surface_count < 1 or (surface_count < 2 and not lens.surfaces[1].mirror):
        fail(
            path, 0, "surfaces", f"expected two or more between object and image, got {max(surface_count, 0)}"
        )
    object_distance = lens.surfaces[0].thickness * lens.millimetres
    rows = _rows(lens)
    stop = next(i for i, row in enumerate(rows) if row.stop)
    try:
        gauss = _gauss(lens, rows, 1.0)
    except ZeroDivisionError:
        fail(path, 0, "focal length", "expected a lens that focuses, got one without power")
    focal_length = float(gauss.cardinal.focal_length)
    if not (math.isfinite(focal_length) and abs(focal_length) > 1e-9):
        fail(path, 0, "focal length", "expected a lens that focuses, got an afocal one")
    radius = _stop_radius(lens, rows[stop], gauss, focal_length, object_distance)
    rows[stop] = replace(rows[stop], semi_diameter=radius)
    pupil = abs(radius * gauss.stop_magnification)
    slope = _field_slope(lens, focal_length, object_distance, gauss)
    rows = _with_clear_apertures(lens, rows, gauss, pupil, slope)
    distances = [at.thickness.get(0, lens.surfaces[0].thickness) for at in lens.positions]
    floating = len(distances) > 1 and len(set(distances)) == len(distances)
    prescription = Prescription(
        name=lens.name or path.stem,
        source=f"{path.name}{': ' + '; '.join(lens.notes) if lens.notes else ''}",
        focal_length=abs(focal_length),
        f_number=abs(focal_length) / pupil / 2,
        image_radius=abs(focal_length) * slope,
        surfaces=tuple(rows),
        design_wavelength=lens.wavelength,
        floating=_floating(lens, distances) if floating else (),
    )
    if (problem := prescription.problem()) is not None:
        fail(path, 0, *problem.split(": ", 1))
    return prescription


def _floating(lens: FileLens, distances: Sequence[float]) -> tuple[FocusRow, ...]:
    """Return the positions of the groups for each object distance, nearest first."""
    rows = []
    for distance, position in sorted(zip(distances, range(1, len(distances) + 1), strict=True)):
        depth = distance * lens.millimetres
        gaps = tuple(row.thickness for row in _rows(lens.at(position)))
        rows.append(FocusRow(distance=depth if depth < MAX_OBJECT_DISTANCE else math.inf, thicknesses=gaps))
    return tuple(rows)


def _check_shape(lens: FileLens, surface: FileSurface) -> None:
    for key, values in (
        ("radius", (0.0 if math.isinf(surface.radius) else surface.radius,)),
        ("conic", (surface.conic,)),
        ("asphere", (*surface.aspheric, *surface.odd)),
        ("aperture", (surface.semi_diameter or 0.0, surface.inner_radius)),
    ):
        invalid = [value for value in values if not math.isfinite(value)]
        if invalid:
            fail(lens.path, surface.line, key, f"expected a number, got {invalid[0]:g}")


def _rows(lens: FileLens) -> list[SurfaceRow]:
    """Return the rows in mm with one plane for the stop, without planes that bend no light."""
    for surface in lens.surfaces[1:-1]:
        _check_shape(lens, surface)
    unit, surfaces = lens.millimetres, _unfolded(lens.surfaces[1:-1])
    if not any(surface.stop for surface in surfaces):
        lens.notes.append("no stop given: the first surface is the stop")
        surfaces[0].stop = True
    rows: list[SurfaceRow] = []
    before: Glass | None = None
    for surface in surfaces:
        has_effect = not surface.is_plane or surface.medium != before or surface.inner_radius > 0
        thickness = surface.thickness * unit
        if not math.isfinite(thickness):
            fail(lens.path, surface.line, "thickness", f"expected a number, got {surface.thickness:g}")
        if surface.radius == 0:
            fail(lens.path, surface.line, "radius", "expected a radius, or infinity for a plane, got 0")
        row = _row(surface, surface.medium, unit)
        plane = SurfaceRow(stop=True, thickness=0.0, semi_diameter=1.0, comment=surface.comment)
        if surface.stop and not has_effect:
            rows.append(replace(_with_medium(plane, before), thickness=thickness))
        elif surface.stop and (
            surface.mirror or surface.inner_radius or (before is None and surface.medium is not None)
        ):
            rows += [_with_medium(plane, before), row]
        elif surface.stop:
            rows += [
                replace(row, thickness=0.0),
                replace(_with_medium(plane, surface.medium), thickness=thickness),
            ]
        elif has_effect:
            rows.append(row)
        elif rows:
            rows[-1] = replace(rows[-1], thickness=rows[-1].thickness + thickness)
        before = surface.medium
    for row, surface in ((row, surface) for row in rows for surface in surfaces if row.thickness < 0):
        if not row.stop and surface.thickness * unit == row.thickness:
            direction = (
                "along the light" if any(other.mirror for other in surfaces) else "to the next surface"
            )
            fail(
                lens.path,
                surface.line,
                "thickness",
                f"expected 0 or more {direction}, got {surface.thickness:g}",
            )
    return rows


def _unfolded(surfaces: Sequence[FileSurface]) -> list[FileSurface]:
    """Return the surfaces of the unfolded system, with radii and distances along the light."""
    direction, unfolded = 1.0, []
    for surface in surfaces:
        shape = direction
        direction = -direction if surface.mirror else direction
        unfolded.append(
            replace(
                surface,
                radius=shape * surface.radius if math.isfinite(surface.radius) else math.inf,
                aspheric=tuple(shape * a for a in surface.aspheric),
                odd=tuple(shape * a for a in surface.odd),
                thickness=direction * surface.thickness + 0.0,
            )
        )
    return unfolded


def _row(surface: FileSurface, medium: Glass | None, unit: float) -> SurfaceRow:
    semi_diameter = surface.semi_diameter
    return _with_medium(
        SurfaceRow(
            radius=surface.radius * unit,
            thickness=surface.thickness * unit,
            conic=surface.conic if math.isfinite(surface.radius) else 0.0,
            aspheric=tuple(a * unit ** (-1 - 2 * i) for i, a in enumerate(surface.aspheric))
            if any(surface.aspheric)
            else (),
            odd=tuple(a * unit ** (-2 - 2 * i) for i, a in enumerate(surface.odd))
            if any(surface.odd)
            else (),
            semi_diameter=semi_diameter * unit
            if semi_diameter is not None and semi_diameter > 0
            else math.nan,
            mirror=surface.mirror,
            inner_radius=surface.inner_radius * unit,
            comment=surface.comment,
        ),
        medium,
    )


def _with_medium(row: SurfaceRow, medium: Glass | None) -> SurfaceRow:
    """Return the row with a medium behind it."""
    if medium is None:
        return row
    key = {"AbbeGlass": "abbe", "SellmeierGlass": "sellmeier", "SchottGlass": "schott"}
    name = key.get(type(medium).__name__)
    if name == "abbe":
        return replace(row, abbe=(medium.nd, medium.vd))  # type: ignore[union-attr]
    if name == "sellmeier":
        return replace(row, sellmeier=(*medium.b, *medium.c))  # type: ignore[union-attr]
    if name == "schott":
        return replace(row, schott=medium.a)  # type: ignore[union-attr]
    kind = "table" if type(medium).__name__ == "TableGlass" else "formula"
    return replace(row, **{kind: medium})  # type: ignore[arg-type]


def _gauss(lens: FileLens, rows: Sequence[SurfaceRow], stop_radius: float) -> ParaxialLens:
    prescription = Prescription(
        name="", source="", focal_length=1.0, f_number=1.0, image_radius=1.0, surfaces=tuple(rows)
    )
    return paraxial_lens(prescription.trace_surfaces(lens.wavelength, stop_radius))


def _stop_radius(
    lens: FileLens, stop: SurfaceRow, gauss: ParaxialLens, focal_length: float, object_distance: float
) -> float:
    """Return the radius of the stop, mm, for the aperture of the file."""
    kind, value = lens.aperture or ("stop", 0.0)
    entrance = abs(float(gauss.stop_magnification))
    if kind == "stop":
        own = next(s.semi_diameter for s in lens.surfaces if s.stop)
        if not own:
            fail(lens.path, 0, "aperture", "expected an f-number, a pupil or the size of the stop, got none")
        return own * lens.millimetres
    if not (math.isfinite(value) and value > 0):
        fail(lens.path, 0, "aperture", f"expected a {kind} above 0, got {value:g}")
    if kind == "epd":
        return value * lens.millimetres / 2 / entrance
    if kind == "f_number":
        return abs(focal_length) / value / 2 / entrance
    if kind == "image_na":
        kind, value = "working_f_number", 0.5 / value
    if kind == "working_f_number":
        return 0.5 / value / _image_slope(gauss, focal_length, object_distance) / entrance
    slope = value / math.sqrt(max(1 - value * value, 1e-12))
    return slope * abs(object_distance + float(gauss.entrance.position)) / entrance


def _image_slope(gauss: ParaxialLens, focal_length: float, object_distance: float) -> float:
    """Return the slope at the image of axial light, per mm of radius of the entrance pupil."""
    if abs(object_distance) > MAX_OBJECT_DISTANCE:
        return 1 / abs(focal_length)
    to_pupil = object_distance + float(gauss.entrance.position)
    to_plane = object_distance + float(gauss.cardinal.front_principal)
    return abs((to_plane / focal_length - 1) / to_pupil)


def _field_slope(lens: FileLens, focal_length: float, object_distance: float, gauss: ParaxialLens) -> float:
    """Return the tangent of the half angle of view to the corner, from the entrance pupil."""
    kind, value = lens.field or ("angle", 0.0)
    value = abs(value)
    if value == 0 or (kind == "angle" and value >= 89):
        lens.notes.append(f"no field below 89 degrees given: {_DEFAULT_FIELD_DEGREES:g} degrees assumed")
        kind, value = "angle", _DEFAULT_FIELD_DEGREES
    if kind == "angle":
        return math.tan(math.radians(value))
    height = value * lens.millimetres
    if kind == "image":
        return height / abs(focal_length)
    return height / max(abs(object_distance + float(gauss.entrance.position)), 1e-9)


def _with_clear_apertures(
    lens: FileLens, rows: list[SurfaceRow], gauss: ParaxialLens, pupil: float, slope: float
) -> list[SurfaceRow]:
    """Return the rows with all clear apertures, mm: those of the file, else the heights of paraxial rays."""
    prescription = Prescription(
        name="", source="", focal_length=1.0, f_number=1.0, image_radius=1.0, surfaces=tuple(rows)
    )
    marginal, chief = (pupil, 0.0), (-float(gauss.entrance.position) * slope, slope)
    place, index, completed, computed = 0.0, 1.0, [], 0
    for row, surface in zip(rows, prescription.trace_surfaces(lens.wavelength), strict=True):
        gap = (surface.vertex - place) / index
        marginal, chief = ((y + gap * nu, nu) for y, nu in (marginal, chief))
        place, index = surface.vertex, surface.behind
        power = float(surface.power)
        ray_height = _APERTURE_MARGIN * (abs(float(marginal[0])) + abs(float(chief[0])))
        marginal, chief = ((y, nu - power * y) for y, nu in (marginal, chief))
        size = row.semi_diameter
        if math.isnan(size):
            size, computed = max(ray_height, 1.01 * row.inner_radius, 1e-6), computed + 1
        if not row.stop and (1 + row.conic) > 0:
            size = min(size, _MAX_HEIGHT_OVER_RADIUS * abs(row.radius) / math.sqrt(1 + row.conic))
        completed.append(replace(row, semi_diameter=size))
    if computed:
        lens.notes.append(f"clear apertures of {computed} surfaces computed from rays to the corner")
    return completed

"""What a lens file of any format says, and how that becomes a prescription.

Rows go from the object to the image, both of them rows as well. Formats differ in what they leave open: where
the stop is a surface with a curvature, how wide it opens, and how wide the others are. That is settled here,
by Gaussian optics, and said.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from bokehnet.errors import LensError
from bokehnet.lenses.prescription_file import FocusRow, Prescription, SurfaceRow
from bokehnet.lenses.pupils import ParaxialLens, paraxial_lens
from bokehnet.optics.spectral.glass import D_LINE, Glass

__all__ = ["FARTHEST", "FileLens", "FilePosition", "FileSurface", "fail", "to_prescription"]

# Clear apertures that a file leaves open are those of Gaussian rays to the corner, and so much more; and no
# surface is wider than this share of its radius.
_WIDER, _WIDEST = 1.05, 0.98
FARTHEST = 1e9  # mm; objects beyond are at infinity
_FIELD = 10.0  # degrees, where a file tells none


@dataclass(kw_only=True)
class FileSurface:
    """One row of a lens file, in its own unit of length.

    Attributes:
        line: Where it begins in the file, from 1.
        radius: Of curvature; infinite is a plane.
        thickness: To the next row.
        medium: Behind it; None is air.
        conic: Conic constant.
        aspheric: Coefficients of the height to the powers 2, 4, 6, ...
        odd: Those to the powers 3, 5, 7, ...
        semi_diameter: Half of the clear aperture; None where the file does not tell.
        inner_radius: Rays nearer to the axis are stopped.
        mirror: Whether it reflects; files count distances against the light behind an odd number of mirrors.
        stop: Whether the aperture stop is here.
        comment: What the file calls it.
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
        """Whether it bends no light in one medium."""
        return math.isinf(self.radius) and not any((*self.aspheric, *self.odd)) and not self.mirror


@dataclass(kw_only=True)
class FilePosition:
    """One position of a zoom, or of groups that move to focus; what it does not tell is that of the file.

    Attributes:
        thickness: By the number of the row; 0 is the distance of the object.
        aperture: The number of the lens's ``aperture``.
    """

    thickness: dict[int, float] = dataclasses.field(default_factory=dict)
    aperture: float | None = None


@dataclass(kw_only=True)
class FileLens:
    """What a lens file says.

    Attributes:
        path: The file.
        name: Title.
        surfaces: From the object to the image, both included.
        millimetres: Of the file's unit of length.
        aperture: ("epd", diameter), ("f_number", N) for an object at infinity, ("working_f_number", N) for
            the object of the file, ("object_na", sine), ("image_na", sine) or ("stop", 0.0): the stop's own
            clear aperture.
        field: ("angle", degrees) from the axis, ("image", height) or ("object", height); the largest.
        positions: Of a zoom, or of groups that move to focus; none where nothing moves.
        wavelength: That focus and pupils are told for, nm.
        said: What the reader has to say, a sentence each.
        skipped: Commands that say nothing of the geometry and were passed over, and how often.
    """

    path: Path
    name: str = ""
    surfaces: list[FileSurface] = dataclasses.field(default_factory=list)
    millimetres: float = 1.0
    aperture: tuple[str, float] | None = None
    field: tuple[str, float] | None = None
    positions: list[FilePosition] = dataclasses.field(default_factory=list)
    wavelength: float = D_LINE
    said: list[str] = dataclasses.field(default_factory=list)
    skipped: dict[str, int] = dataclasses.field(default_factory=dict)

    def skip(self, command: str) -> None:
        """Count a command that was passed over."""
        self.skipped[command] = self.skipped.get(command, 0) + 1

    def at(self, position: int) -> "FileLens":
        """The lens with its groups in a position, counted from 1.

        Raises:
            LensError: There are not so many.
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
        told = self.positions[position - 1]
        surfaces = [
            replace(surface, thickness=told.thickness.get(row, surface.thickness))
            for row, surface in enumerate(self.surfaces)
        ]
        aperture = self.aperture
        if aperture is not None and told.aperture is not None:
            aperture = (aperture[0], told.aperture)
        return replace(self, surfaces=surfaces, aperture=aperture, said=list(self.said))


def fail(path: Path, line: int, key: str, problem: str) -> NoReturn:
    """Raise a ``LensError`` that names file, line and key."""
    raise LensError(f"{path}, line {line}: {key}: {problem}" if line else f"{path}: {key}: {problem}")


def to_prescription(lens: FileLens) -> Prescription:
    """Return the prescription that a lens file describes, in mm, as it stands in its surfaces.

    Positions that differ in the distance of their object are how the groups stand when it is focused there.

    Raises:
        LensError: Nothing is there to be a lens, it does not focus, or a row cannot be.
    """
    path = lens.path
    between = len(lens.surfaces) - 2
    if between < 1 or (between < 2 and not lens.surfaces[1].mirror):
        fail(path, 0, "surfaces", f"expected two or more between object and image, got {max(between, 0)}")
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
    distances = [one.thickness.get(0, lens.surfaces[0].thickness) for one in lens.positions]
    floating = len(distances) > 1 and len(set(distances)) == len(distances)
    prescription = Prescription(
        name=lens.name or path.stem,
        source=f"{path.name}{': ' + '; '.join(lens.said) if lens.said else ''}",
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
    """How the groups stand for each distance of the object, nearest first."""
    found = []
    for distance, position in sorted(zip(distances, range(1, len(distances) + 1), strict=True)):
        away = distance * lens.millimetres
        gaps = tuple(row.thickness for row in _rows(lens.at(position)))
        found.append(FocusRow(distance=away if away < FARTHEST else math.inf, thicknesses=gaps))
    return tuple(found)


def _check_shape(lens: FileLens, surface: FileSurface) -> None:
    for key, values in (
        ("radius", (0.0 if math.isinf(surface.radius) else surface.radius,)),
        ("conic", (surface.conic,)),
        ("asphere", (*surface.aspheric, *surface.odd)),
        ("aperture", (surface.semi_diameter or 0.0, surface.inner_radius)),
    ):
        wrong = [value for value in values if not math.isfinite(value)]
        if wrong:
            fail(lens.path, surface.line, key, f"expected a number, got {wrong[0]:g}")


def _rows(lens: FileLens) -> list[SurfaceRow]:
    """Rows in mm with one plane for the stop; planes that bend nothing are left out."""
    for surface in lens.surfaces[1:-1]:
        _check_shape(lens, surface)
    unit, inner = lens.millimetres, _seen_in_mirrors(lens.surfaces[1:-1])
    if not any(surface.stop for surface in inner):
        lens.said.append("no stop is told: it is put on the first surface")
        inner[0].stop = True
    rows: list[SurfaceRow] = []
    before: Glass | None = None
    for surface in inner:
        bends = not surface.is_plane or surface.medium != before or surface.inner_radius > 0
        stands = surface.thickness * unit
        if not math.isfinite(stands):
            fail(lens.path, surface.line, "thickness", f"expected a number, got {surface.thickness:g}")
        if surface.radius == 0:
            fail(lens.path, surface.line, "radius", "expected a radius, or infinity for a plane, got 0")
        row = _row(surface, surface.medium, unit)
        plane = SurfaceRow(stop=True, thickness=0.0, semi_diameter=1.0, comment=surface.comment)
        if surface.stop and not bends:
            rows.append(replace(_in(plane, before), thickness=stands))
        elif surface.stop and (
            surface.mirror or surface.inner_radius or (before is None and surface.medium is not None)
        ):
            rows += [_in(plane, before), row]
        elif surface.stop:
            rows += [replace(row, thickness=0.0), replace(_in(plane, surface.medium), thickness=stands)]
        elif bends:
            rows.append(row)
        elif rows:
            rows[-1] = replace(rows[-1], thickness=rows[-1].thickness + stands)
        before = surface.medium
    for row, surface in ((row, surface) for row in rows for surface in inner if row.thickness < 0):
        if not row.stop and surface.thickness * unit == row.thickness:
            way = "along the light" if any(one.mirror for one in inner) else "to the next surface"
            fail(lens.path, surface.line, "thickness", f"expected 0 or more {way}, got {surface.thickness:g}")
    return rows


def _seen_in_mirrors(surfaces: Sequence[FileSurface]) -> list[FileSurface]:
    """The surfaces with radii and distances along the light: turned behind every mirror."""
    turn, seen = 1.0, []
    for surface in surfaces:
        shape = turn
        turn = -turn if surface.mirror else turn
        seen.append(
            replace(
                surface,
                radius=shape * surface.radius if math.isfinite(surface.radius) else math.inf,
                aspheric=tuple(shape * a for a in surface.aspheric),
                odd=tuple(shape * a for a in surface.odd),
                thickness=turn * surface.thickness + 0.0,
            )
        )
    return seen


def _row(surface: FileSurface, medium: Glass | None, unit: float) -> SurfaceRow:
    known = surface.semi_diameter
    return _in(
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
            semi_diameter=known * unit if known is not None and known > 0 else math.nan,
            mirror=surface.mirror,
            inner_radius=surface.inner_radius * unit,
            comment=surface.comment,
        ),
        medium,
    )


def _in(row: SurfaceRow, medium: Glass | None) -> SurfaceRow:
    """The row with a medium behind it."""
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
    made = Prescription(
        name="", source="", focal_length=1.0, f_number=1.0, image_radius=1.0, surfaces=tuple(rows)
    )
    return paraxial_lens(made.trace_surfaces(lens.wavelength, stop_radius))


def _stop_radius(
    lens: FileLens, stop: SurfaceRow, gauss: ParaxialLens, focal_length: float, object_distance: float
) -> float:
    """Radius of the stop, mm, that gives the aperture of the file."""
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
    """Slope at the image, over 1 mm of radius of the entrance pupil, of light from the object on the axis."""
    if abs(object_distance) > FARTHEST:
        return 1 / abs(focal_length)
    to_pupil = object_distance + float(gauss.entrance.position)
    to_plane = object_distance + float(gauss.cardinal.front_principal)
    return abs((to_plane / focal_length - 1) / to_pupil)


def _field_slope(lens: FileLens, focal_length: float, object_distance: float, gauss: ParaxialLens) -> float:
    """Tangent of the angle between the axis and the corner of the picture, seen from the entrance pupil."""
    kind, value = lens.field or ("angle", 0.0)
    value = abs(value)
    if value == 0 or (kind == "angle" and value >= 89):
        lens.said.append(f"no field that a flat picture holds is told: {_FIELD:g} degrees are taken")
        kind, value = "angle", _FIELD
    if kind == "angle":
        return math.tan(math.radians(value))
    height = value * lens.millimetres
    if kind == "image":
        return height / abs(focal_length)
    return height / max(abs(object_distance + float(gauss.entrance.position)), 1e-9)


def _with_clear_apertures(
    lens: FileLens, rows: list[SurfaceRow], gauss: ParaxialLens, pupil: float, slope: float
) -> list[SurfaceRow]:
    """The rows with all clear apertures, mm: those of the file, else what Gaussian rays need."""
    made = Prescription(
        name="", source="", focal_length=1.0, f_number=1.0, image_radius=1.0, surfaces=tuple(rows)
    )
    marginal, chief = (pupil, 0.0), (-float(gauss.entrance.position) * slope, slope)
    place, index, found, guessed = 0.0, 1.0, [], 0
    for row, surface in zip(rows, made.trace_surfaces(lens.wavelength), strict=True):
        gap = (surface.vertex - place) / index
        marginal, chief = ((y + gap * nu, nu) for y, nu in (marginal, chief))
        place, index = surface.vertex, surface.behind
        power = float(surface.power)
        needed = _WIDER * (abs(float(marginal[0])) + abs(float(chief[0])))
        marginal, chief = ((y, nu - power * y) for y, nu in (marginal, chief))
        size = row.semi_diameter
        if math.isnan(size):
            size, guessed = max(needed, 1.01 * row.inner_radius, 1e-6), guessed + 1
        if not row.stop and (1 + row.conic) > 0:
            size = min(size, _WIDEST * abs(row.radius) / math.sqrt(1 + row.conic))
        found.append(replace(row, semi_diameter=size))
    if guessed:
        lens.said.append(f"clear apertures of {guessed} surfaces are ours, by rays to the corner")
    return found

"""Lens prescription and its TOML file: surfaces from the scene to the sensor, in millimetres.

::

    name = "Double Gauss"
    source = "Tronnier, US 2,673,491, 1954"
    focal_length = 100.0
    f_number = 2.0
    image_radius = 40.0

    [[surfaces]]
    radius = 58.95
    thickness = 7.52
    abbe = [1.670, 47.1]
    semi_diameter = 25.2

    [[surfaces]]
    stop = true
    thickness = 9.0
    semi_diameter = 17.1
"""

import dataclasses
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from bokehnet.config import load_config
from bokehnet.errors import ConfigError, LensError, errors_of_file
from bokehnet.lenses.surface_trace import Surface
from bokehnet.optics.spectral.glass import (
    D_LINE,
    AbbeGlass,
    FormulaGlass,
    Glass,
    SchottGlass,
    SellmeierGlass,
    TableGlass,
    make_glass,
)

__all__ = ["FocusRow", "Prescription", "SurfaceRow", "read_prescription"]

_MEDIA = ("glass", "abbe", "sellmeier", "schott", "formula", "table")
# Upper bound of the tilt of a surface, degrees; manufacturing errors are smaller.
_MAX_TILT_DEGREES = 45.0
_Six = tuple[float, float, float, float, float, float]


# Smallest and largest length, mm, and f-number: beyond them rays lose all digits of double precision.
_MIN_POSITIVE, _MAX_LENGTH_MM = 1e-6, 1e9


@dataclass(frozen=True, kw_only=True, slots=True)
class SurfaceRow:
    """One surface and the medium behind it; air unless a glass is given.

    Attributes:
        thickness: Distance to the next surface along the axis, mm; for the last surface, as published, to the
            image of infinity (unused: the focus is computed).
        semi_diameter: Half of the clear aperture, mm.
        radius: Radius of curvature, mm, positive if its centre lies behind; infinite is a plane.
        conic: Conic constant; 0 is a sphere.
        aspheric: Even aspheric terms of the sag: coefficients of the height to the
            powers 2, 4, 6, ..., mm^-1, mm^-3, ...
        odd: Odd aspheric terms of the sag: powers 3, 5, 7, ..., mm^-2, mm^-4, ...
        stop: True for the aperture stop: a plane in air, or in the glass of the row in front of it,
            which the stop then repeats. Only a stop may lie behind the next surface, with a thickness below
            0.
        glass: Name of a glass of :mod:`bokehnet.optics.spectral.glass`.
        abbe: Index nd and Abbe number Vd.
        sellmeier: b1, b2, b3, c1, c2, c3.
        schott: a0 to a5.
        formula: Any other formula, as :class:`bokehnet.optics.spectral.glass.FormulaGlass`.
        table: Wavelengths, nm, and indices, as :class:`bokehnet.optics.spectral.glass.TableGlass`.
        mirror: True for a mirror; the medium behind it, along the light, equals that in front. Radii
            and distances behind a mirror are those of the unfolded system: thicknesses stay positive, and
            radii above 0 have their centre in the direction of the light.
        inner_radius: Radius below which rays are blocked, mm: by the back of another mirror, or a
            hole.
        shift: Decentring of the vertex, x, y and along the light, mm, of one copy
            of a lens, as assembled by :mod:`bokehnet.lenses.assembly.tolerances`.
        tilt: Rotation of the surface about its vertex, degrees about axes along x and y.
        comment: Name of the surface in the source.
    """

    thickness: float
    semi_diameter: float
    radius: float = math.inf
    conic: float = 0.0
    aspheric: tuple[float, ...] = ()
    odd: tuple[float, ...] = ()
    stop: bool = False
    glass: str | None = None
    abbe: tuple[float, float] | None = None
    sellmeier: _Six | None = None
    schott: _Six | None = None
    formula: FormulaGlass | None = None
    table: TableGlass | None = None
    mirror: bool = False
    inner_radius: float = 0.0
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt: tuple[float, float] = (0.0, 0.0)
    comment: str = ""

    def problem(self, in_front: Glass | None) -> str | None:
        """Return a description of the first invalid value, starting with its key, or None.

        Args:
            in_front: Glass in front of the surface; None is air.
        """
        media = [key for key in _MEDIA if getattr(self, key) is not None]
        if len(media) > 1:
            return f"{media[0]}: expected one way to describe the glass, got {' and '.join(media)}"
        if self.stop and (math.isfinite(self.radius) or self.aspheric or self.odd):
            return "stop: expected a plane in air, got a radius"
        if self.radius == 0 or math.isnan(self.radius):
            return f"radius: expected a radius, or inf for a plane, got {self.radius:g}"
        if (self.thickness < 0 and not self.stop) or not abs(self.thickness) <= _MAX_LENGTH_MM:
            return f"thickness: expected 0 to {_MAX_LENGTH_MM:g}, got {self.thickness:g}"
        if not _MIN_POSITIVE <= self.semi_diameter <= _MAX_LENGTH_MM:
            expected = f"{_MIN_POSITIVE:g} to {_MAX_LENGTH_MM:g}"
            return f"semi_diameter: expected {expected}, got {self.semi_diameter:g}"
        if self.semi_diameter**2 * (1 + self.conic) >= self.radius**2:
            return f"semi_diameter: {self.semi_diameter:g} reaches beyond the radius of {self.radius:g}"
        if not 0 <= self.inner_radius < self.semi_diameter or (self.stop and self.inner_radius):
            limit = "0, at a stop," if self.stop else f"0 to less than {self.semi_diameter:g}"
            return f"inner_radius: expected {limit}, got {self.inner_radius:g}"
        for key in ("shift", "tilt"):
            value = getattr(self, key)
            if not all(map(math.isfinite, value)) or (self.stop and any(value)):
                expected = "nothing, at a stop, which stays on the axis" if self.stop else "finite numbers"
                return f"{key}: expected {expected}, got {list(value)}"
        if max(map(abs, self.tilt)) >= _MAX_TILT_DEGREES:
            return f"tilt: expected less than {_MAX_TILT_DEGREES:g} degrees, got {list(self.tilt)}"
        if self.stop and self.mirror:
            return "mirror: expected separate rows for stop and mirror, got both in one"
        if self.abbe is not None and not (self.abbe[0] > 1 and self.abbe[1] > 0):
            return f"abbe: expected [nd above 1, Vd above 0], got {list(self.abbe)}"
        try:
            behind = self.medium()
        except LensError as error:
            return f"glass: {error}"
        if self.stop and behind != in_front:
            return "stop: expected a plane in air, or the glass in front of it named again, got another"
        if self.mirror and behind != in_front:
            return "mirror: expected air, or the glass in front of it named again, got another"
        return None

    def medium(self) -> Glass | None:
        """Return the glass behind the surface, or None for air."""
        if self.glass is not None:
            return make_glass(self.glass)
        if self.abbe is not None:
            return AbbeGlass(*self.abbe)
        if self.sellmeier is not None:
            return SellmeierGlass(self.sellmeier[:3], self.sellmeier[3:])
        if self.schott is not None:
            return SchottGlass(self.schott)
        return self.formula or self.table


@dataclass(frozen=True, kw_only=True, slots=True)
class FocusRow:
    """Gaps between the surfaces of a lens that is focused at one distance.

    Attributes:
        distance: Distance from the first surface to the object in focus, mm; may be infinite.
        thicknesses: Thicknesses of all rows, mm.
    """

    distance: float
    thicknesses: tuple[float, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Prescription:
    """Lens as published.

    Attributes:
        name: Name of the lens.
        source: Author, title, year or patent, and any changes.
        focal_length: Published focal length, mm, for comparison with that of the surfaces.
        f_number: Published f-number at full aperture.
        image_radius: Radius of the image circle, mm, in focus at infinity.
        surfaces: Surfaces from the scene to the sensor.
        design_wavelength: Wavelength of focus and pupils, nm.
        floating: Positions of floating groups, nearest distance first; empty if the lens moves as a whole.
    """

    name: str
    source: str
    focal_length: float
    f_number: float
    image_radius: float
    surfaces: tuple[SurfaceRow, ...]
    design_wavelength: float = D_LINE
    floating: tuple[FocusRow, ...] = ()

    def problem(self) -> str | None:
        """Return a description of the first invalid value, starting with its key, or None."""
        for key in ("focal_length", "f_number", "image_radius", "design_wavelength"):
            if not _MIN_POSITIVE <= getattr(self, key) <= _MAX_LENGTH_MM:
                number = getattr(self, key)
                return f"{key}: expected {_MIN_POSITIVE:g} to {_MAX_LENGTH_MM:g}, got {number:g}"
        min_rows = 2 if any(row.mirror for row in self.surfaces) else 3
        if len(self.surfaces) < min_rows or sum(row.stop for row in self.surfaces) != 1:
            stops = sum(row.stop for row in self.surfaces)
            rows = f"{len(self.surfaces)} rows with {stops} stops"
            return f"surfaces: expected two or more, and one with stop = true, got {rows}"
        distances = [row.distance for row in self.floating]
        if distances and not (distances[0] > 0 and all(a < b for a, b in pairwise(distances))):
            return f"floating: expected distances above 0 that rise, got {distances}"
        for i, row in enumerate(self.floating):
            if len(row.thicknesses) != len(self.surfaces):
                count = len(row.thicknesses)
                return (
                    f"floating[{i}].thicknesses: expected {len(self.surfaces)} as there are rows, got {count}"
                )
        medium: Glass | None = None
        for i, surface in enumerate(self.surfaces):
            if (problem := surface.problem(medium)) is not None:
                return f"surfaces[{i}].{problem}"
            medium = surface.medium()
        return "surfaces: expected air behind the last one, got a glass" if medium is not None else None

    def focused(self, distance: float) -> "Prescription":
        """Return the lens with its floating groups at their positions for a focus distance.

        Gaps are interpolated linearly in inverse distance, and constant beyond the tabulated distances.

        Args:
            distance: Distance from the first surface, mm; may be infinite.
        """
        if not self.floating:
            return self
        negative_vergence = [-1 / row.distance for row in self.floating]
        surfaces = tuple(
            dataclasses.replace(
                row,
                thickness=float(
                    np.interp(-1 / distance, negative_vergence, [at.thicknesses[i] for at in self.floating])
                ),
            )
            for i, row in enumerate(self.surfaces)
        )
        return dataclasses.replace(self, surfaces=surfaces)

    @property
    def centred(self) -> bool:
        """True if all surfaces are centred on the axis."""
        return not any(any(row.shift) or any(row.tilt) for row in self.surfaces)

    def with_surfaces_centred(self) -> "Prescription":
        """Return the lens with every surface centred on the axis."""
        rows = (dataclasses.replace(row, shift=(0.0, 0.0, 0.0), tilt=(0.0, 0.0)) for row in self.surfaces)
        return dataclasses.replace(self, surfaces=tuple(rows))

    def scaled(self, factor: float) -> "Prescription":
        """Return the lens with every length multiplied by ``factor``."""
        surfaces = tuple(
            dataclasses.replace(
                row,
                thickness=factor * row.thickness,
                semi_diameter=factor * row.semi_diameter,
                inner_radius=factor * row.inner_radius,
                radius=factor * row.radius,
                shift=(factor * row.shift[0], factor * row.shift[1], factor * row.shift[2]),
                aspheric=tuple(a * factor ** (-1 - 2 * i) for i, a in enumerate(row.aspheric)),
                odd=tuple(a * factor ** (-2 - 2 * i) for i, a in enumerate(row.odd)),
            )
            for row in self.surfaces
        )
        return dataclasses.replace(
            self,
            surfaces=surfaces,
            focal_length=factor * self.focal_length,
            image_radius=factor * self.image_radius,
            floating=tuple(
                FocusRow(
                    distance=factor * row.distance, thicknesses=tuple(factor * t for t in row.thicknesses)
                )
                for row in self.floating
            ),
        )

    def trace_surfaces(self, wavelength: float, stop_radius: float | None = None) -> tuple[Surface, ...]:
        """Return the surfaces for :func:`bokehnet.lenses.surface_trace.trace`.

        Args:
            wavelength: Wavelength of the refractive indices, nm, a number, array or tensor.
            stop_radius: Radius of the aperture stop, mm; None is fully open.
        """
        surfaces, before, vertex = [], 1.0, 0.0
        for row in self.surfaces:
            medium = row.medium()
            behind = 1.0 if medium is None else medium.index(wavelength)
            radius = stop_radius if row.stop and stop_radius is not None else row.semi_diameter
            surfaces.append(
                Surface(
                    vertex=vertex,
                    curvature=1 / row.radius,
                    semi_diameter=radius,
                    conic=row.conic,
                    before=before,
                    behind=behind,
                    stop=row.stop,
                    aspheric=row.aspheric,
                    odd=row.odd,
                    mirror=row.mirror,
                    inner_radius=row.inner_radius,
                    shift=row.shift,
                    tilt=(math.radians(row.tilt[0]), math.radians(row.tilt[1])),
                )
            )
            before, vertex = behind, vertex + row.thickness
        return tuple(surfaces)


def read_prescription(path: str | Path) -> Prescription:
    """Read a prescription file.

    Raises:
        ConfigError: The file is missing or not TOML, a key is unknown or absent, or a value has the wrong
            type or is invalid; the message names file and key.
    """
    prescription = load_config(path, Prescription)
    with errors_of_file(path, "a lens", ConfigError):
        problem = prescription.problem()
    if problem is not None:
        raise ConfigError(f"{path}: {problem}")
    return prescription

"""What a lens prescription file says: surfaces from the scene to the sensor, in millimetres.

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
from bokehnet.errors import ConfigError, LensError
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
# Degrees by which a surface can be turned; more is no fault of a copy.
_STEEPEST = 45.0
_Six = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class SurfaceRow:
    """One surface and what lies behind it; without a glass that is air.

    Attributes:
        thickness: Distance to the next surface along the axis, mm; of the last one, as published, to the
            image of infinity (not used: focusing is solved for).
        semi_diameter: Half of the clear aperture, mm.
        radius: Radius of curvature, mm, positive when its centre lies behind; infinite is a plane.
        conic: Conic constant; 0 is a sphere.
        aspheric: What an even asphere adds to the depth of the conic: coefficients of the height to the
            powers 2, 4, 6, ..., mm^-1, mm^-3, ...
        odd: The same of the powers 3, 5, 7, ..., mm^-2, mm^-4, ...
        stop: Whether this is the aperture stop: a plane in air, or in the glass of the row in front of it,
            which it then names again. Only a stop may stand behind what comes next, thickness below 0.
        glass: Name of a glass that :mod:`bokehnet.optics.spectral.glass` knows.
        abbe: Index nd and Abbe number Vd.
        sellmeier: b1, b2, b3, c1, c2, c3.
        schott: a0 to a5.
        formula: Any other formula, as :class:`bokehnet.optics.spectral.glass.FormulaGlass`.
        table: Wavelengths, nm, and indices, as :class:`bokehnet.optics.spectral.glass.TableGlass`.
        mirror: Whether it reflects; what is behind it, in the way of the light, is what was in front. Radii
            and distances behind a mirror are told as seen in it: thicknesses stay positive, and radii
            above 0 have their centre where the light goes.
        inner_radius: Rays nearer to the axis than this are stopped, mm: by the back of another mirror, or a
            hole.
        shift: How far the vertex stands off its place on the axis, x, y and along the light, mm; of one copy
            of a lens, as :mod:`bokehnet.lenses.assembly.tolerances` puts it together.
        tilt: Degrees about axes along x and y by which the surface is turned about its vertex.
        comment: What the source calls the surface.
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
        """Say what no surface can have, beginning with the key; ``in_front`` is the glass in front of it."""
        media = [key for key in _MEDIA if getattr(self, key) is not None]
        if len(media) > 1:
            return f"{media[0]}: expected one way to tell the glass, got {' and '.join(media)}"
        if self.stop and (math.isfinite(self.radius) or self.aspheric or self.odd):
            return "stop: expected a plane in air, got a radius"
        if self.radius == 0 or math.isnan(self.radius):
            return f"radius: expected a radius, or inf for a plane, got {self.radius:g}"
        if (self.thickness < 0 and not self.stop) or not math.isfinite(self.thickness):
            return f"thickness: expected 0 or more, got {self.thickness:g}"
        if not 0 < self.semi_diameter < math.inf:
            return f"semi_diameter: expected more than 0, got {self.semi_diameter:g}"
        if self.semi_diameter**2 * (1 + self.conic) >= self.radius**2:
            return f"semi_diameter: {self.semi_diameter:g} reaches beyond the radius of {self.radius:g}"
        if not 0 <= self.inner_radius < self.semi_diameter or (self.stop and self.inner_radius):
            limit = "0, at a stop," if self.stop else f"0 to less than {self.semi_diameter:g}"
            return f"inner_radius: expected {limit}, got {self.inner_radius:g}"
        for key in ("shift", "tilt"):
            value = getattr(self, key)
            if not all(map(math.isfinite, value)) or (self.stop and any(value)):
                where = "nothing, at a stop, which stays on the axis" if self.stop else "finite numbers"
                return f"{key}: expected {where}, got {list(value)}"
        if max(map(abs, self.tilt)) >= _STEEPEST:
            return f"tilt: expected less than {_STEEPEST:g} degrees, got {list(self.tilt)}"
        if self.stop and self.mirror:
            return "mirror: expected a stop of its own beside the mirror, got both in one"
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
    """How the groups of a lens stand when it is focused at one distance.

    Attributes:
        distance: From the first surface to what is in focus, mm; may be infinite.
        thicknesses: Of all rows, mm.
    """

    distance: float
    thicknesses: tuple[float, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Prescription:
    """A lens as published.

    Attributes:
        name: What it is called.
        source: Author, title, year or patent, and what was changed.
        focal_length: Published focal length, mm, for comparison with what the surfaces give.
        f_number: Published f-number at full aperture.
        image_radius: Radius of the picture that it is made for, mm, in focus at infinity.
        surfaces: From the scene to the sensor.
        design_wavelength: Wavelength that focus and pupils are told for, nm.
        floating: How groups move to focus, nearest distance first; none where the lens moves as one piece.
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
        """Say what no lens can have, beginning with the key, or return None."""
        for key in ("focal_length", "f_number", "image_radius", "design_wavelength"):
            if not 0 < getattr(self, key) < math.inf:
                return f"{key}: expected more than 0, got {getattr(self, key):g}"
        fewest = 2 if any(row.mirror for row in self.surfaces) else 3
        if len(self.surfaces) < fewest or sum(row.stop for row in self.surfaces) != 1:
            stops = sum(row.stop for row in self.surfaces)
            found = f"{len(self.surfaces)} rows with {stops} stops"
            return f"surfaces: expected two or more, and one with stop = true, got {found}"
        distances = [row.distance for row in self.floating]
        if distances and not (distances[0] > 0 and all(a < b for a, b in pairwise(distances))):
            return f"floating: expected distances above 0 that rise, got {distances}"
        for i, told in enumerate(self.floating):
            if len(told.thicknesses) != len(self.surfaces):
                count = len(told.thicknesses)
                return (
                    f"floating[{i}].thicknesses: expected {len(self.surfaces)} as there are rows, got {count}"
                )
        medium: Glass | None = None
        for i, row in enumerate(self.surfaces):
            if (problem := row.problem(medium)) is not None:
                return f"surfaces[{i}].{problem}"
            medium = row.medium()
        return "surfaces: expected air behind the last one, got a glass" if medium is not None else None

    def focused(self, distance: float) -> "Prescription":
        """Return the lens with its groups as they stand when it is focused at a distance.

        Between the distances that are told, gaps are linear in one over the distance; beyond them they stay.

        Args:
            distance: From the first surface, mm; may be infinite.
        """
        if not self.floating:
            return self
        nearness = [-1 / row.distance for row in self.floating]
        surfaces = tuple(
            dataclasses.replace(
                row,
                thickness=float(
                    np.interp(-1 / distance, nearness, [at.thicknesses[i] for at in self.floating])
                ),
            )
            for i, row in enumerate(self.surfaces)
        )
        return dataclasses.replace(self, surfaces=surfaces)

    @property
    def centred(self) -> bool:
        """Whether all surfaces stand on the axis."""
        return not any(any(row.shift) or any(row.tilt) for row in self.surfaces)

    def with_surfaces_centred(self) -> "Prescription":
        """Return the lens with every surface on the axis."""
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
            wavelength: Nanometres, a number, array or tensor; it gives the refractive indices.
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
        ConfigError: It is missing or not TOML, a key is unknown or absent, a value has the wrong type or
            cannot be; file and key are named.
    """
    prescription = load_config(path, Prescription)
    if (problem := prescription.problem()) is not None:
        raise ConfigError(f"{path}: {problem}")
    return prescription

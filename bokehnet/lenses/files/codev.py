"""CODE V sequences, ``.seq``: rotationally symmetric lenses of spheres, conics and even aspheres.

Source: the commands as "CODE V reference manual" names them.
"""

import math
import re
import shlex
from pathlib import Path

from bokehnet.errors import LensError
from bokehnet.lenses.files.glasses import GlassCatalogues
from bokehnet.lenses.files.media import medium_of
from bokehnet.lenses.files.structure import FileLens, FilePosition, FileSurface, fail
from bokehnet.lenses.files.text import number, read_lines
from bokehnet.optics.spectral.glass import Glass, TableGlass

__all__ = ["read_codev"]

_UNITS = {"M": 1.0, "MM": 1.0, "C": 10.0, "CM": 10.0, "I": 25.4, "IN": 25.4}
_APERTURES = {"EPD": "epd", "FNO": "working_f_number", "NAO": "object_na", "NA": "image_na"}
_FIELDS = {
    **dict.fromkeys(("XAN", "YAN"), "angle"),
    **dict.fromkeys(("XOB", "YOB"), "object"),
    **dict.fromkeys(("XIM", "YIM", "XRI", "YRI"), "image"),
}
# Letters of an asphere's powers, from the fourth on.
_POWERS = "ABCDEFGH"
# What turns or shifts surfaces, or bends light by other means; of no harm where all their numbers are 0.
_REFUSED = {
    "XDE",
    "YDE",
    "ZDE",
    "ADE",
    "BDE",
    "CDE",
    "GRO",
    "GRX",
    "GRY",
    "DIF",
    "CYL",
    "XTO",
    "YTO",
    "NSS",
    "GRT",
}
_REFUSED |= {"SPS", "BEN", "DAR", "RET", "DEC", "HOE", "DOE", "HCT"}


def read_codev(path: Path, catalogues: GlassCatalogues) -> FileLens:
    """Read a sequence of CODE V.

    Raises:
        LensError: It is none, or its surfaces are no spheres, conics or even aspheres about one axis.
    """
    state = _State(path, catalogues)
    for line, command in _commands(path):
        try:
            words = shlex.split(command, posix=True)
        except ValueError:
            words = command.split()
        if not words:
            continue
        try:
            state.take(line, words[0].upper(), words[1:])
        except LensError:
            raise
        except (ValueError, IndexError) as error:
            fail(path, line, words[0], f"expected numbers, got {' '.join(words[1:])[:60]!r} ({error})")
    return state.finish()


def _commands(path: Path) -> list[tuple[int, str]]:
    """Commands with the line on which each begins: ``;`` parts them, ``&`` joins lines, ``!`` is a remark."""
    found: list[tuple[int, str]] = []
    open_line, held = 0, ""
    for line, text in enumerate(read_lines(path), start=1):
        text = re.split(r"!(?=(?:[^'\"]*['\"][^'\"]*['\"])*[^'\"]*$)", text)[0].strip()
        held, open_line = (held + " " + text, open_line) if held else (text, line)
        if held.endswith("&"):
            held = held[:-1]
            continue
        parts = re.split(r";(?=(?:[^'\"]*['\"][^'\"]*['\"])*[^'\"]*$)", held)
        found += [(open_line, part.strip()) for part in parts if part.strip()]
        held = ""
    return found


class _State:
    """What has been read so far."""

    def __init__(self, path: Path, catalogues: GlassCatalogues) -> None:
        self.lens, self.catalogues = FileLens(path=path), catalogues
        self.radii: bool | None = None
        self.bends: list[float] = []
        self.wavelengths: list[float] = []
        self.primary = 0
        self.private: dict[str, Glass] = {}
        self.private_lines: list[float] | None = None

    def take(self, line: int, key: str, words: list[str]) -> None:
        """Take one command."""
        lens = self.lens
        if self.private_lines is not None:
            self.of_private(key, words)
        elif key == "PRV":
            self.private_lines = []
        elif key == "RDM":
            self.radii = not words or words[0].upper() not in ("N", "NO")
        elif key in ("TITLE", "TIT"):
            lens.name = " ".join(words).strip()
        elif key == "DIM":
            if words[0].upper() not in _UNITS:
                fail(lens.path, line, key, f"expected one of {', '.join(_UNITS)}, got {words[0]}")
            lens.millimetres = _UNITS[words[0].upper()]
        elif key in _APERTURES:
            lens.aperture = (_APERTURES[key], number(words[-1]))
        elif key in _FIELDS:
            largest = max((abs(number(word)) for word in words), default=0.0)
            if lens.field is None or largest > lens.field[1]:
                lens.field = (_FIELDS[key], largest)
        elif key == "WL":
            self.wavelengths = [number(word) for word in words]
        elif key == "REF":
            self.primary = int(number(words[0])) - 1
        elif key in ("ZOO", "ZOOM"):
            self.zoom(line, words)
        elif key in ("SO", "SI", "S") or re.fullmatch(r"S\d+", key):
            self.surface(line, key, words)
        elif lens.surfaces and self.of_surface(line, key, words):
            return
        else:
            lens.skip(key)

    def zoom(self, line: int, words: list[str]) -> None:
        """Take how many positions there are, or a distance or the aperture in each of them."""
        lens, what = self.lens, words[0].upper() if words else ""
        if len(words) == 1 and what.isdigit():
            lens.positions = [FilePosition() for _ in range(int(what))]
        elif what == "THI" and len(words) > 2:
            row = words[1].upper().lstrip("S")
            numbers = [number(word) for word in words[2:]]
            self.each_position(line, numbers)
            for one, thickness in zip(lens.positions, numbers, strict=False):
                one.thickness[int(row) if row else 0] = thickness
        elif what in _APERTURES and len(words) > 1:
            numbers = [number(word) for word in words[1:]]
            self.each_position(line, numbers)
            for one, value in zip(lens.positions, numbers, strict=False):
                one.aperture = value
        else:
            lens.skip(f"ZOO {what}".strip())

    def each_position(self, line: int, numbers: list[float]) -> None:
        """Refuse a list that has not a number for each position."""
        count = len(self.lens.positions)
        if len(numbers) != count:
            fail(
                self.lens.path,
                line,
                "ZOO",
                f"expected a number for each of {count} positions, got {len(numbers)}",
            )

    def of_private(self, key: str, words: list[str]) -> None:
        """Take a line of the private catalogue: PWL and wavelengths, then names and indices, END."""
        assert self.private_lines is not None
        if key == "END":
            self.private_lines = None
        elif key == "PWL":
            self.private_lines = [number(word) for word in words]
        elif self.private_lines and len(words) == len(self.private_lines):
            known = sorted(zip(self.private_lines, map(number, words), strict=True))
            if len(known) > 1:
                self.private[key.upper()] = TableGlass(
                    wavelengths=tuple(w for w, _ in known), indices=tuple(n for _, n in known)
                )

    def surface(self, line: int, key: str, words: list[str]) -> None:
        """Take a new row: radius or curvature, thickness, glass."""
        lens = self.lens
        bend = number(words[0]) if words else 0.0
        medium, mirror = None, False
        if len(words) > 2:
            name = words[2]
            if name.upper() == "REFL":
                medium, mirror = lens.surfaces[-1].medium if lens.surfaces else None, True
            elif name.upper() in self.private:
                medium = self.private[name.upper()]
            else:
                glass, _, maker = name.partition("_")
                medium = medium_of(lens, line, key, glass, self.catalogues, maker=maker)
        thickness = number(words[1]) if len(words) > 1 else 0.0
        self.bends.append(bend)
        lens.surfaces.append(FileSurface(line=line, thickness=thickness, medium=medium, mirror=mirror))

    def of_surface(self, line: int, key: str, words: list[str]) -> bool:
        """Take a command of the last surface; False where it says nothing that counts."""
        lens, surface = self.lens, self.lens.surfaces[-1]
        if key == "STO":
            at = int(words[0].upper().lstrip("S")) if words else len(lens.surfaces) - 1
            lens.surfaces[at].stop = True
        elif key in ("CIR", "CIX"):
            if len(words) == 1:
                surface.semi_diameter = number(words[0])
            elif words[0].upper() in ("OBS", "HOL"):  # else it is an edge
                surface.inner_radius = number(words[-1])
        elif key == "K":
            surface.conic = number(words[-1])
        elif len(key) == 1 and key in _POWERS:
            index = _POWERS.index(key) + 1
            powers = [*surface.aspheric, *[0.0] * (index + 1 - len(surface.aspheric))]
            powers[index] = number(words[-1])
            surface.aspheric = tuple(powers)
        elif key == "SLB":
            surface.comment = " ".join(words)
        elif key == "THI" and len(words) == 1:
            surface.thickness = number(words[0])
        elif key in ("RDY", "CUY") and len(words) == 1:
            self.bends[-1] = number(words[0])
        elif key in _REFUSED:
            values = [word for word in words if re.fullmatch(r"[-+.\dEeDd]+", word)]
            if values and all(number(word) == 0 for word in values):
                lens.skip(key)
            else:
                fail(lens.path, line, key, "expected surfaces of one axis that refract, got something else")
        else:
            return key in ("ASP", "CON", "SPH")
        return True

    def finish(self) -> FileLens:
        """Return the lens, with what counts for all of it."""
        lens = self.lens
        if not lens.surfaces:
            fail(lens.path, 0, "S", "expected surfaces, got none; is this a sequence of CODE V?")
        if self.radii is None:
            bent = [abs(bend) for bend in self.bends if bend]
            self.radii = bool(bent) and min(bent) > 1
            if self.radii:
                lens.said.append("no RDM is told: numbers above 1 are taken for radii")
        for surface, bend in zip(lens.surfaces, self.bends, strict=True):
            surface.radius = math.inf if bend == 0 else bend if self.radii else 1 / bend
        if self.wavelengths:
            middle = min(max(self.primary, 0), len(self.wavelengths) - 1)
            lens.wavelength = self.wavelengths[middle]
        return lens

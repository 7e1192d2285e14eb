"""CODE V sequences, ``.seq``: rotationally symmetric lenses of spheres, conics and even aspheres.

Source: command names of the "CODE V reference manual".
"""

import math
import re
from pathlib import Path

from bokehnet.errors import LensError
from bokehnet.lenses.files.glass.glasses import GlassCatalogues
from bokehnet.lenses.files.glass.media import GlassEntry, medium_of
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
# Letters of the powers of an asphere, from the fourth on.
_POWERS = "ABCDEFGH"
# Commands that move surfaces or bend light by other means; accepted if all their numbers are 0.
_UNSUPPORTED = {"XDE", "YDE", "ZDE", "ADE", "BDE", "CDE", "GRO", "GRX", "GRY", "DIF", "CYL", "XTO"}
_UNSUPPORTED |= {"YTO", "NSS", "GRT", "SPS", "BEN", "DAR", "RET", "DEC", "HOE", "DOE", "HCT"}
# Words, and pieces of a line: quoted texts stay whole.
_WORD = re.compile(r"""(?:"[^"]*"|'[^']*'|\S)+""")
_PIECE = re.compile(r""""[^"]*"|'[^']*'|!+|;+|[^"'!;]+|["']""")


def read_codev(path: Path, catalogues: GlassCatalogues) -> FileLens:
    """Read a CODE V sequence.

    Raises:
        LensError: The file is not a sequence, or has surfaces other than spheres, conics or even aspheres
            about one axis.
    """
    state = _State(path, catalogues)
    for line, command in _commands(path):
        words = [word.replace('"', "").replace("'", "") for word in _WORD.findall(command)]
        if not words:
            continue
        try:
            state.read_command(line, words[0].upper(), words[1:])
        except LensError:
            raise
        except (ValueError, IndexError) as error:
            fail(path, line, words[0], f"expected numbers, got {' '.join(words[1:])[:60]!r} ({error})")
    return state.finish()


def _commands(path: Path) -> list[tuple[int, str]]:
    """Return commands with their first line: ``;`` separates them, ``&`` joins lines, ``!`` is a comment."""
    commands: list[tuple[int, str]] = []
    open_line, pending = 0, list[str]()
    for line, text in enumerate(read_lines(path), start=1):
        text = _split(text, "!")[0].strip()
        open_line = open_line if pending else line
        pending.append(text.removesuffix("&"))
        if not text.endswith("&"):
            parts = _split(" ".join(pending), ";")
            commands += [(open_line, part.strip()) for part in parts if part.strip()]
            pending = []
    return commands


def _split(text: str, separator: str) -> list[str]:
    """Return the parts of a text between separators outside quotation marks."""
    parts, start = [], 0
    for piece in _PIECE.finditer(text):
        if piece[0][0] == separator:
            parts.append(text[start : piece.start()])
            start = piece.end()
    return [*parts, text[start:]]


class _State:
    """State of reading a sequence."""

    def __init__(self, path: Path, catalogues: GlassCatalogues) -> None:
        self.lens, self.catalogues = FileLens(path=path), catalogues
        self.radii: bool | None = None
        self.radius_values: list[float] = []
        self.wavelengths: list[float] = []
        self.primary = 0
        self.private: dict[str, Glass] = {}
        self.private_lines: list[float] | None = None

    def read_command(self, line: int, key: str, words: list[str]) -> None:
        """Read one command."""
        lens = self.lens
        if self.private_lines is not None:
            self.read_private_glass(key, words)
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
            self.read_zoom(line, words)
        elif key in ("SO", "SI", "S") or re.fullmatch(r"S\d+", key):
            self.surface(line, key, words)
        elif lens.surfaces and self.read_surface_command(line, key, words):
            return
        else:
            lens.skip(key)

    def read_zoom(self, line: int, words: list[str]) -> None:
        """Read the number of positions, or a distance or the aperture for each of them."""
        lens, quantity = self.lens, words[0].upper() if words else ""
        if len(words) == 1 and quantity.isdigit():
            lens.positions = [FilePosition() for _ in range(int(quantity))]
        elif quantity == "THI" and len(words) > 2:
            row = words[1].upper().lstrip("S")
            numbers = [number(word) for word in words[2:]]
            self.check_position_count(line, numbers)
            for position, thickness in zip(lens.positions, numbers, strict=False):
                position.thickness[int(row) if row else 0] = thickness
        elif quantity in _APERTURES and len(words) > 1:
            numbers = [number(word) for word in words[1:]]
            self.check_position_count(line, numbers)
            for position, value in zip(lens.positions, numbers, strict=False):
                position.aperture = value
        else:
            lens.skip(f"ZOO {quantity}".strip())

    def check_position_count(self, line: int, numbers: list[float]) -> None:
        """Raise ``LensError`` unless there is a number for each position."""
        count = len(self.lens.positions)
        if len(numbers) != count:
            fail(
                self.lens.path,
                line,
                "ZOO",
                f"expected a number for each of {count} positions, got {len(numbers)}",
            )

    def read_private_glass(self, key: str, words: list[str]) -> None:
        """Read a line of the private catalogue: PWL and wavelengths, then names and indices, END."""
        assert self.private_lines is not None
        if key == "END":
            self.private_lines = None
        elif key == "PWL":
            self.private_lines = [number(word) for word in words]
        elif self.private_lines and len(words) == len(self.private_lines):
            samples = sorted(zip(self.private_lines, map(number, words), strict=True))
            if len(samples) > 1:
                self.private[key.upper()] = TableGlass(
                    wavelengths=tuple(w for w, _ in samples), indices=tuple(n for _, n in samples)
                )

    def surface(self, line: int, key: str, words: list[str]) -> None:
        """Read a new row: radius or curvature, thickness, glass."""
        lens = self.lens
        value = number(words[0]) if words else 0.0
        medium, mirror = None, False
        if len(words) > 2:
            name = words[2]
            if name.upper() == "REFL":
                medium, mirror = lens.surfaces[-1].medium if lens.surfaces else None, True
            elif name.upper() in self.private:
                medium = self.private[name.upper()]
            else:
                glass, _, maker = name.partition("_")
                named = GlassEntry(line=line, key=key, name=glass, maker=maker)
                medium = medium_of(lens, named, self.catalogues)
        thickness = number(words[1]) if len(words) > 1 else 0.0
        self.radius_values.append(value)
        lens.surfaces.append(FileSurface(line=line, thickness=thickness, medium=medium, mirror=mirror))

    def read_surface_command(self, line: int, key: str, words: list[str]) -> bool:
        """Read a command of the last surface; return False if it is irrelevant."""
        lens, surface = self.lens, self.lens.surfaces[-1]
        if key == "STO":
            at = int(words[0].upper().lstrip("S")) if words else len(lens.surfaces) - 1
            lens.surfaces[at].stop = True
        elif key in ("CIR", "CIX"):
            if len(words) == 1:
                surface.semi_diameter = number(words[0])
            elif words[0].upper() in ("OBS", "HOL"):  # otherwise an edge
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
            self.radius_values[-1] = number(words[0])
        elif key in _UNSUPPORTED:
            values = [word for word in words if re.fullmatch(r"[-+.\dEeDd]+", word)]
            if values and all(number(word) == 0 for word in values):
                lens.skip(key)
            else:
                fail(lens.path, line, key, "expected refracting surfaces on one axis, got something else")
        else:
            return key in ("ASP", "CON", "SPH")
        return True

    def finish(self) -> FileLens:
        """Return the lens, with properties of the whole file."""
        lens = self.lens
        if not lens.surfaces:
            fail(lens.path, 0, "S", "expected surfaces, got none; is this a sequence of CODE V?")
        if self.radii is None:
            sizes = [abs(value) for value in self.radius_values if value]
            self.radii = bool(sizes) and min(sizes) > 1
            if self.radii:
                lens.notes.append("no RDM given: numbers above 1 are read as radii")
        for surface, value in zip(lens.surfaces, self.radius_values, strict=True):
            surface.radius = math.inf if value == 0 else value if self.radii else 1 / value
        if self.wavelengths:
            middle = min(max(self.primary, 0), len(self.wavelengths) - 1)
            lens.wavelength = self.wavelengths[middle]
        return lens

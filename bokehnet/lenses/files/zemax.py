"""Zemax and OpticStudio, ``.zmx``: sequential lenses of spheres, conics and even aspheres.

Source: the file format as "OpticStudio user manual" tells it of ``.ZMX`` files, and files themselves.
"""

import math
from pathlib import Path

from bokehnet.errors import LensError
from bokehnet.lenses.files.forbes import mild_powers, strong_powers
from bokehnet.lenses.files.glasses import GlassCatalogues
from bokehnet.lenses.files.media import medium_of
from bokehnet.lenses.files.structure import FileLens, FilePosition, FileSurface, fail
from bokehnet.lenses.files.text import number, read_lines

__all__ = ["read_zemax"]

_UNITS = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "M": 1000.0, "METER": 1000.0}
_FIELDS = {0: "angle", 1: "object", 2: "image", 3: "image"}
# Surfaces whose shape is known, and how many powers their parameters tell.
_SHAPES = {"STANDARD": 0, "EVENASPH": 8, "ODDASPHE": 8, "QED_TYPE": 0}


def read_zemax(path: Path, catalogues: GlassCatalogues) -> FileLens:
    """Read a sequential lens of Zemax.

    Raises:
        LensError: It is none, or has surfaces that are no spheres, conics or even aspheres about one axis.
    """
    lens = FileLens(path=path)
    state = _State(lens, catalogues)
    for line, text in enumerate(read_lines(path), start=1):
        key, _, rest = text.strip().partition(" ")
        if not key:
            continue
        try:
            state.take(line, key.upper(), rest.split(), rest)
        except LensError:
            raise
        except (ValueError, IndexError) as error:
            fail(path, line, key, f"expected numbers, got {rest.strip()[:60]!r} ({error})")
    return state.finish()


class _State:
    """What has been read so far."""

    def __init__(self, lens: FileLens, catalogues: GlassCatalogues) -> None:
        self.lens, self.catalogues = lens, catalogues
        self.kind = "STANDARD"
        self.forbes: dict[int, dict[int, float]] = {}
        self.wavelengths: dict[int, float] = {}
        self.primary, self.configurations = 1, 1
        self.moving: dict[int, dict[int, float]] = {}
        self.field_kind, self.fields = 0, [0.0]

    def take(self, line: int, key: str, words: list[str], rest: str) -> None:
        """Take one command."""
        lens = self.lens
        if key == "SURF":
            lens.surfaces.append(FileSurface(line=line))
            self.kind = "STANDARD"
        elif key == "MODE" and words[0] != "SEQ":
            fail(lens.path, line, key, f"expected SEQ, a sequential lens, got {words[0]}")
        elif key == "NAME":
            lens.name = rest.strip()
        elif key == "UNIT":
            if words[0].upper() not in _UNITS:
                fail(lens.path, line, key, f"expected one of {', '.join(_UNITS)}, got {words[0]}")
            lens.millimetres = _UNITS[words[0].upper()]
        elif key in ("ENPD", "FNUM", "OBNA", "FLOA"):
            value = number(words[0]) if words else 0.0
            kinds = {"ENPD": "epd", "FNUM": "f_number", "OBNA": "object_na", "FLOA": "stop"}
            lens.aperture = (kinds[key], value)
        elif key == "FTYP":
            self.field_kind = int(number(words[0]))
        elif key in ("XFLN", "YFLN", "XFLD", "YFLD"):
            self.fields += [number(word) for word in words]
        elif key == "WAVM":
            self.wavelengths[int(words[0])] = 1000 * number(words[1])
        elif key in ("WAVL", "WAVN"):
            self.wavelengths |= {i: 1000 * number(word) for i, word in enumerate(words, start=1)}
        elif key == "PWAV":
            self.primary = int(number(words[0]))
        elif key == "MNUM":
            self.configurations = int(number(words[0]))
        elif key == "THIC" and len(words) > 2:
            row, position = int(number(words[0])), int(number(words[1]))
            self.moving.setdefault(position, {})[row] = number(words[2])
        elif lens.surfaces and self.of_surface(line, key, words, rest):
            return
        else:
            lens.skip(key)

    def of_surface(self, line: int, key: str, words: list[str], rest: str) -> bool:
        """Take a command of the last surface; False where it is none that counts."""
        lens, surface = self.lens, self.lens.surfaces[-1]
        if key == "TYPE":
            self.kind = words[0].upper()
            if self.kind not in _SHAPES and self.kind != "COORDBRK":
                known = ", ".join(_SHAPES)
                fail(
                    lens.path,
                    line,
                    key,
                    f"expected one of {known}, got {self.kind}: its shape is not known here",
                )
        elif key == "STOP":
            surface.stop = True
        elif key == "CURV":
            curvature = number(words[0])
            surface.radius = 1 / curvature if curvature else math.inf
        elif key == "CONI":
            surface.conic = number(words[0])
        elif key == "DISZ":
            surface.thickness = number(words[0])
        elif key == "DIAM":
            surface.semi_diameter = number(words[0]) or None
        elif key in ("OBSC", "CLAP"):  # smallest and largest radius: of what is dark, or of what is clear
            sizes = [number(word) for word in words[:2]]
            surface.inner_radius = sizes[1] if key == "OBSC" else sizes[0]
            if key == "CLAP":
                surface.semi_diameter = sizes[1] or None
        elif key == "COMM":
            surface.comment = rest.strip()
        elif key == "GLAS":
            self.glass(line, words)
        elif key == "XDAT" and self.kind == "QED_TYPE":
            own = self.forbes.setdefault(len(lens.surfaces) - 1, {})
            own[int(number(words[0]))] = number(words[1])
        elif key == "PARM":
            self.parameter(line, int(number(words[0])), number(words[1]))
        else:
            return False
        return True

    def glass(self, line: int, words: list[str]) -> None:
        """Take a glass or a mirror; index and Abbe number are those of a model, or what Zemax fills in."""
        surfaces = self.lens.surfaces
        if words[0].upper() == "MIRROR":
            surfaces[-1].mirror, surfaces[-1].medium = True, surfaces[-2].medium
            return
        given = [number(word) for word in words[1:5]]
        model = len(given) == 4 and given[0] >= 1
        told = len(given) == 4 and (model or given[2:] != [1.5, 40.0]) and given[2] > 1
        nd, vd = (given[2], given[3]) if told else (None, None)
        self.lens.surfaces[-1].medium = medium_of(
            self.lens, line, "GLAS", words[0], self.catalogues, nd=nd, vd=vd
        )

    def parameter(self, line: int, index: int, value: float) -> None:
        """Take a parameter of the surface's shape."""
        surface = self.lens.surfaces[-1]
        if value == 0:
            return
        if self.kind == "COORDBRK" and index <= 5:
            fail(self.lens.path, line, "PARM", "expected surfaces about one axis, got a shift or a tilt")
        if self.kind == "EVENASPH" and 1 <= index <= _SHAPES["EVENASPH"]:
            powers = [*surface.aspheric, *[0.0] * (index - len(surface.aspheric))]
            powers[index - 1] = value
            surface.aspheric = tuple(powers)
        elif self.kind == "ODDASPHE" and index == 1:
            fail(self.lens.path, line, "PARM", "expected a surface without a tip, got a power of 1")
        elif self.kind == "ODDASPHE" and index <= _SHAPES["ODDASPHE"]:
            name, place = ("odd", (index - 3) // 2) if index % 2 else ("aspheric", index // 2 - 1)
            held = getattr(surface, name)
            powers = [*held, *[0.0] * (place + 1 - len(held))]
            powers[place] = value
            setattr(surface, name, tuple(powers))

    def q_type(self, surface: FileSurface, told: dict[int, float]) -> None:
        """Take a Q-type asphere: its kind, how many terms, the radius that they span, and the terms."""
        terms = [told.get(3 + i, 0.0) for i in range(1, int(told.get(2, 0)) + 1)]
        if told.get(1, 0.0) == 0:
            surface.aspheric = strong_powers(terms, told[3])
        elif told[3] < 0.9 * abs(surface.radius):  # it is told from a sphere, whatever conic stands beside it
            surface.conic, surface.aspheric = 0.0, mild_powers(terms, told[3], 1 / surface.radius)
        else:
            limit = f"{0.9 * abs(surface.radius):g}"
            fail(
                self.lens.path,
                surface.line,
                "XDAT",
                f"expected a radius of terms below {limit}, got {told[3]:g}",
            )

    def finish(self) -> FileLens:
        """Return the lens, with what counts for all of it."""
        lens = self.lens
        if not lens.surfaces:
            fail(lens.path, 0, "SURF", "expected surfaces, got none; is this a lens of Zemax?")
        for place, told in self.forbes.items():
            self.q_type(lens.surfaces[place], told)
        known = self.wavelengths.get(self.primary) or next(iter(self.wavelengths.values()), None)
        if known:
            lens.wavelength = known
        lens.field = (_FIELDS.get(self.field_kind, "angle"), max(map(abs, self.fields)))
        lens.positions = [
            FilePosition(thickness=self.moving.get(i, {})) for i in range(1, self.configurations + 1)
        ]
        if not self.moving:
            lens.positions = []
            if self.configurations > 1:
                lens.said.append(f"of {self.configurations} configurations no distances are told")
        return lens

"""Zemax and OpticStudio, ``.zmx``: sequential lenses of spheres, conics and even aspheres.

Source: the description of ``.ZMX`` files in the "OpticStudio user manual", and files themselves.
"""

import math
from pathlib import Path

from bokehnet.errors import LensError
from bokehnet.lenses.files.forbes import mild_powers, strong_powers
from bokehnet.lenses.files.glass.glasses import GlassCatalogues
from bokehnet.lenses.files.glass.media import GlassEntry, medium_of
from bokehnet.lenses.files.structure import FileLens, FilePosition, FileSurface, fail
from bokehnet.lenses.files.text import number, read_lines

__all__ = ["read_zemax"]

_UNITS = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "M": 1000.0, "METER": 1000.0}
_FIELDS = {0: "angle", 1: "object", 2: "image", 3: "image"}
# Supported surface types, with their number of polynomial coefficients.
_SHAPES = {"STANDARD": 0, "EVENASPH": 8, "ODDASPHE": 8, "QED_TYPE": 0}


def read_zemax(path: Path, catalogues: GlassCatalogues) -> FileLens:
    """Read a sequential Zemax lens.

    Raises:
        LensError: The file is not a lens, or has surfaces other than spheres, conics or even aspheres about
            one axis.
    """
    lens = FileLens(path=path)
    state = _State(lens, catalogues)
    for line, text in enumerate(read_lines(path), start=1):
        key, _, rest = text.strip().partition(" ")
        if not key:
            continue
        try:
            state.read_command(line, key.upper(), rest.split(), rest)
        except LensError:
            raise
        except (ValueError, IndexError) as error:
            fail(path, line, key, f"expected numbers, got {rest.strip()[:60]!r} ({error})")
    return state.finish()


class _State:
    """State of reading a file."""

    def __init__(self, lens: FileLens, catalogues: GlassCatalogues) -> None:
        self.lens, self.catalogues = lens, catalogues
        self.kind = "STANDARD"
        self.forbes: dict[int, dict[int, float]] = {}
        self.wavelengths: dict[int, float] = {}
        self.primary, self.configurations = 1, 1
        self.moving: dict[int, dict[int, float]] = {}
        self.field_kind, self.fields = 0, [0.0]

    def read_command(self, line: int, key: str, words: list[str], rest: str) -> None:
        """Read one command."""
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
        elif lens.surfaces and self.read_surface_command(line, key, words, rest):
            return
        else:
            lens.skip(key)

    def read_surface_command(self, line: int, key: str, words: list[str], rest: str) -> bool:
        """Read a command of the last surface; return False if it is irrelevant."""
        lens, surface = self.lens, self.lens.surfaces[-1]
        if key == "TYPE":
            self.kind = words[0].upper()
            if self.kind not in _SHAPES and self.kind != "COORDBRK":
                supported = ", ".join(_SHAPES)
                fail(
                    lens.path,
                    line,
                    key,
                    f"expected one of {supported}, got {self.kind}, which is not supported",
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
        elif key in ("OBSC", "CLAP"):  # inner and outer radius of the obscuration, or of the clear area
            sizes = [number(word) for word in words[:2]]
            surface.inner_radius = sizes[1] if key == "OBSC" else sizes[0]
            if key == "CLAP":
                surface.semi_diameter = sizes[1] or None
        elif key == "COMM":
            surface.comment = rest.strip()
        elif key == "GLAS":
            self.glass(line, words)
        elif key == "XDAT" and self.kind == "QED_TYPE":
            terms = self.forbes.setdefault(len(lens.surfaces) - 1, {})
            terms[int(number(words[0]))] = number(words[1])
        elif key == "PARM":
            self.parameter(line, int(number(words[0])), number(words[1]))
        else:
            return False
        return True

    def glass(self, line: int, words: list[str]) -> None:
        """Read a glass or a mirror; index and Abbe number are those of a model or defaults of Zemax."""
        surfaces = self.lens.surfaces
        if words[0].upper() == "MIRROR":
            surfaces[-1].mirror, surfaces[-1].medium = True, surfaces[-2].medium
            return
        values = [number(word) for word in words[1:5]]
        model = len(values) == 4 and values[0] >= 1
        has_index = len(values) == 4 and (model or values[2:] != [1.5, 40.0]) and values[2] > 1
        nd, vd = (values[2], values[3]) if has_index else (None, None)
        self.lens.surfaces[-1].medium = medium_of(
            self.lens, GlassEntry(line=line, key="GLAS", name=words[0], nd=nd, vd=vd), self.catalogues
        )

    def parameter(self, line: int, index: int, value: float) -> None:
        """Read a parameter of the shape of the surface."""
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
            existing = getattr(surface, name)
            powers = [*existing, *[0.0] * (place + 1 - len(existing))]
            powers[place] = value
            setattr(surface, name, tuple(powers))

    def q_type(self, surface: FileSurface, parameters: dict[int, float]) -> None:
        """Read a Q-type asphere: its kind, number of terms, normalization radius, and the terms."""
        terms = [parameters.get(3 + i, 0.0) for i in range(1, int(parameters.get(2, 0)) + 1)]
        if parameters.get(1, 0.0) == 0:
            surface.aspheric = strong_powers(terms, parameters[3])
        elif parameters[3] < 0.9 * abs(surface.radius):  # relative to a sphere; the conic constant is ignored
            surface.conic, surface.aspheric = 0.0, mild_powers(terms, parameters[3], 1 / surface.radius)
        else:
            limit = f"{0.9 * abs(surface.radius):g}"
            fail(
                self.lens.path,
                surface.line,
                "XDAT",
                f"expected a radius of terms below {limit}, got {parameters[3]:g}",
            )

    def finish(self) -> FileLens:
        """Return the lens, with properties of the whole file."""
        lens = self.lens
        if not lens.surfaces:
            fail(lens.path, 0, "SURF", "expected surfaces, got none; is this a lens of Zemax?")
        for place, parameters in self.forbes.items():
            self.q_type(lens.surfaces[place], parameters)
        wavelength = self.wavelengths.get(self.primary) or next(iter(self.wavelengths.values()), None)
        if wavelength:
            lens.wavelength = wavelength
        lens.field = (_FIELDS.get(self.field_kind, "angle"), max(map(abs, self.fields)))
        lens.positions = [
            FilePosition(thickness=self.moving.get(i, {})) for i in range(1, self.configurations + 1)
        ]
        if not self.moving:
            lens.positions = []
            if self.configurations > 1:
                lens.notes.append(f"no distances given for {self.configurations} configurations")
        return lens

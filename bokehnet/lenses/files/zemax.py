"""Zemax and OpticStudio, ``.zmx``: sequential lenses of spheres, conics and even aspheres.

Source: the file format as "OpticStudio user manual" tells it of ``.ZMX`` files, and files themselves.
"""

import math
from pathlib import Path

from bokehnet.errors import LensError
from bokehnet.lenses.files.glasses import GlassCatalogues
from bokehnet.lenses.files.media import medium_of
from bokehnet.lenses.files.structure import FileLens, FileSurface, fail
from bokehnet.lenses.files.text import number, read_lines

__all__ = ["read_zemax"]

_UNITS = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "M": 1000.0, "METER": 1000.0}
_FIELDS = {0: "angle", 1: "object", 2: "image", 3: "image"}
# Surfaces whose shape is known, and how many powers their parameters tell.
_SHAPES = {"STANDARD": 0, "EVENASPH": 8}


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
        self.wavelengths: dict[int, float] = {}
        self.primary, self.configurations = 1, 1
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
        elif key == "COMM":
            surface.comment = rest.strip()
        elif key == "GLAS":
            self.glass(line, words)
        elif key == "PARM":
            self.parameter(line, int(number(words[0])), number(words[1]))
        else:
            return False
        return True

    def glass(self, line: int, words: list[str]) -> None:
        """Take a glass; index and Abbe number are those of a model, or what Zemax fills in."""
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

    def finish(self) -> FileLens:
        """Return the lens, with what counts for all of it."""
        lens = self.lens
        if not lens.surfaces:
            fail(lens.path, 0, "SURF", "expected surfaces, got none; is this a lens of Zemax?")
        known = self.wavelengths.get(self.primary) or next(iter(self.wavelengths.values()), None)
        if known:
            lens.wavelength = known
        lens.field = (_FIELDS.get(self.field_kind, "angle"), max(map(abs, self.fields)))
        if self.configurations > 1:
            lens.said.append(f"the first of {self.configurations} configurations")
        return lens

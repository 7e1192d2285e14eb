"""OSLO lenses, ``.len``: rotationally symmetric lenses of spheres, conics and even aspheres.

Source: command names of the "OSLO optics reference".
"""

import math
import shlex
from pathlib import Path

from bokehnet.errors import LensError
from bokehnet.lenses.files.glass.glasses import GlassCatalogues
from bokehnet.lenses.files.glass.media import GlassEntry, medium_of
from bokehnet.lenses.files.structure import FileLens, FileSurface, fail
from bokehnet.lenses.files.text import number, read_lines

__all__ = ["read_oslo"]

_POWERS = {"AD": 2, "AE": 3, "AF": 4, "AG": 5}  # powers of the squared height
# Commands that move surfaces, or bend light by other means.
_UNSUPPORTED = {"RFL", "RFH", "DCX", "DCY", "DCZ", "TLA", "TLB", "TLC", "CVX", "GOR", "GSP", "DOE"}
_UNSUPPORTED |= {"PFL", "PFP"}
_FLAGS = {"RFL", "RFH"}


def read_oslo(path: Path, catalogues: GlassCatalogues) -> FileLens:
    """Read an OSLO lens.

    Raises:
        LensError: The file is not a lens, or has surfaces other than spheres, conics or even aspheres about
            one axis.
    """
    lens = FileLens(path=path, surfaces=[FileSurface(line=1)])
    has_header = False
    for line, text in enumerate(read_lines(path), start=1):
        text = text.partition("//")[0].strip()
        if not text:
            continue
        try:
            words = shlex.split(text)
        except ValueError:
            words = text.split()
        key, rest = words[0].upper(), words[1:]
        has_header = has_header or key == "LEN"
        try:
            _read_command(lens, catalogues, line, key, rest)
        except LensError:
            raise
        except (ValueError, IndexError) as error:
            fail(path, line, key, f"expected numbers, got {' '.join(rest)[:60]!r} ({error})")
    if not has_header:
        fail(path, 0, "LEN", "expected LEN NEW, got none; is this a lens of OSLO?")
    return lens


def _read_command(lens: FileLens, catalogues: GlassCatalogues, line: int, key: str, words: list[str]) -> None:
    surface = lens.surfaces[-1]
    if key == "LEN":
        lens.name = next(
            (word for word in words if word.upper() != "NEW" and not _is_number(word)), lens.name
        )
    elif key == "DES":
        lens.skip(key)
    elif key == "UNI":
        lens.millimetres = number(words[0])
    elif key == "EBR":
        lens.aperture = ("epd", 2 * number(words[0]))
    elif key == "FNB":
        lens.aperture = ("f_number", number(words[0]))
    elif key == "NAO":
        lens.aperture = ("object_na", number(words[0]))
    elif key == "ANG":
        lens.field = ("angle", number(words[0]))
    elif key == "OBH":
        lens.field = ("object", number(words[0]))
    elif key == "GIH":
        lens.field = ("image", number(words[0]))
    elif key == "WV":
        lens.wavelength = 1000 * number(words[0])
    elif key == "NXT":
        lens.surfaces.append(FileSurface(line=line))
    elif key == "RD":
        radius = number(words[0])
        surface.radius = radius if radius else math.inf
    elif key == "CV":
        surface.radius = 1 / number(words[0]) if number(words[0]) else math.inf
    elif key == "TH":
        surface.thickness = number(words[0])
    elif key == "CC":
        surface.conic = number(words[0])
    elif key in _POWERS:
        place = _POWERS[key] - 1
        powers = [*surface.aspheric, *[0.0] * (place + 1 - len(surface.aspheric))]
        powers[place] = number(words[0])
        surface.aspheric = tuple(powers)
    elif key == "AP":
        sizes = [word for word in words if _is_number(word)]
        surface.semi_diameter = number(sizes[0]) if sizes else None
    elif key == "AST":
        lens.surfaces[int(words[0]) if words else -1].stop = True
    elif key in ("RFL", "RFH"):
        surface.mirror, surface.medium = True, lens.surfaces[-2].medium
    elif key == "AIR":
        surface.medium = None
    elif key == "GLA":
        nd = number(words[1]) if len(words) > 1 and _is_number(words[1]) else None
        vd = number(words[2]) if len(words) > 2 and _is_number(words[2]) else None
        if vd is not None and nd is not None and vd < 3:  # indices at F and C instead of an Abbe number
            vd = (nd - 1) / abs(vd - number(words[3])) if len(words) > 3 else None
        named = GlassEntry(line=line, key=key, name=words[0], nd=nd, vd=vd)
        surface.medium = medium_of(lens, named, catalogues)
    elif key in ("PK", "PKP") or (key in _UNSUPPORTED and (key in _FLAGS or any(map(_is_not_zero, words)))):
        fail(lens.path, line, key, "expected refracting surfaces on one axis, in numbers, got something else")
    else:
        lens.skip(key)


def _is_number(word: str) -> bool:
    try:
        number(word)
    except ValueError:
        return False
    return True


def _is_not_zero(word: str) -> bool:
    return _is_number(word) and number(word) != 0

"""Conversion of glass names of a lens file to glasses, with notes on approximations."""

import re
from dataclasses import dataclass

from bokehnet.lenses.files.glass.glasses import GlassCatalogues, approximate, plain_name
from bokehnet.lenses.files.glass.old_glasses import OLD_GLASSES
from bokehnet.lenses.files.structure import FileLens, fail
from bokehnet.optics.spectral.glass import FormulaGlass, Glass

__all__ = ["GlassEntry", "medium_of"]

_AIR = {"", "AIR", "VACUUM"}


@dataclass(frozen=True, kw_only=True, slots=True)
class GlassEntry:
    """Glass as a lens file names it.

    Attributes:
        line: Line of the entry in the file.
        key: Name of the entry.
        name: Name of the glass.
        maker: Maker of the glass, if known.
        nd: Index in the file.
        vd: Abbe number in the file; 0 is no dispersion.
    """

    line: int
    key: str
    name: str
    maker: str = ""
    nd: float | None = None
    vd: float | None = None


def medium_of(lens: FileLens, entry: GlassEntry, catalogues: GlassCatalogues) -> Glass | None:
    """Return the medium of an entry; None is air.

    Glasses of the catalogues come first, then codes of six digits (517642 is nd 1.517, Vd 64.2) and of index
    and Abbe number (1.517:64.2), then the values in the file itself.

    Args:
        lens: Lens that receives notes on approximations.
        entry: Glass in the file.
        catalogues: Catalogues to search.

    Raises:
        LensError: Unknown glass.
    """
    name, nd, vd = entry.name, entry.nd, entry.vd
    if name.upper() in _AIR:
        return None
    glass = catalogues.find(name, entry.maker)
    if glass is not None:
        return glass
    if match := re.fullmatch(r"(\d{3})\.?(\d{3})|(\d\.\d+):(\d+\.?\d*)|(\d{6,9})\.(\d{1,6})", name):
        nd, vd = _code(match)
    elif re.fullmatch(r"[12]\.\d*", name):
        return FormulaGlass(root=1.0, powers=((float(name), 0.0),))
    elif (nd is None or not nd > 1) and plain_name(name) in OLD_GLASSES:
        nd, vd = OLD_GLASSES[plain_name(name)]
    if nd is None or not nd > 1:
        remedy = "give its catalogue, an AGF file or refractiveindex.info's YAML, by --glasses"
        fail(lens.path, entry.line, entry.key, f"expected a known glass, got {name!r}; {remedy}")
    vd = vd or 0.0
    lens.notes.append(
        f"{name} approximated by nd {nd:g}, Vd {vd:g}" if vd else f"{name} has the constant index {nd:g}"
    )
    return approximate(nd, vd)


def _code(match: re.Match[str]) -> tuple[float, float]:
    if match[1]:
        return 1 + int(match[1]) / 1000, int(match[2]) / 10
    if match[3]:
        return float(match[3]), float(match[4])
    digits, rest = match[5], match[6]
    return 1 + float(f"0.{digits}"), float(f"{rest[:2]}.{rest[2:] or 0}")

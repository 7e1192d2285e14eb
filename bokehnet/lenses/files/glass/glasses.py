"""Glasses by name: AGF catalogues, refractiveindex.info YAML, and approximations of unknown glasses.

Names are compared without case, dashes and blanks, so that ``NBK7_SCHOTT``, ``N-BK7`` and ``nbk7`` are equal.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from bokehnet.errors import LensError, errors_of_file
from bokehnet.lenses.files.text import read_lines
from bokehnet.optics.spectral.glass import AbbeGlass, FormulaGlass, Glass, TableGlass, make_glass

__all__ = ["GlassCatalogues", "approximate", "plain_name", "read_agf", "read_yaml_glass"]

# Malitson, "Interspecimen comparison of the refractive index of fused silica", 1965, and "A redetermination
# of some optical properties of calcium fluoride", 1963.
_SILICA = ((0.6961663, 0.0684043), (0.4079426, 0.1162414), (0.8974794, 9.896161))
_FLUORITE = ((0.5675888, 0.050263605), (0.4710914, 0.1003909), (3.8484723, 34.649040))
_MATERIALS: dict[str, Glass] = {
    name: FormulaGlass(powers=((1.0, 0.0),), poles=tuple((b, 2.0, pole**2, 1.0) for b, pole in pairs))
    for names, pairs in ((("SILICA", "FSILICA", "SIO2", "FUSEDSILICA"), _SILICA), (("CAF2",), _FLUORITE))
    for name in names
}

_Powers = tuple[tuple[float, float], ...]


@dataclass
class GlassCatalogues:
    """Glasses of given files and folders, then those of :mod:`bokehnet.optics.spectral.glass`.

    Attributes:
        places: AGF files, YAML files, and folders of these; the first that contains a name defines it.
    """

    places: tuple[Path, ...] = ()
    _agf: dict[Path, dict[str, Glass]] = field(default_factory=dict, repr=False)
    _yaml: dict[Path, dict[str, list[Path]]] = field(default_factory=dict, repr=False)

    def find(self, name: str, maker: str = "") -> Glass | None:
        """Return the glass called ``name``, preferring ``maker`` if there are several; None if unknown."""
        key = plain_name(name)
        for place in self.places:
            for path in sorted(place.rglob("*.[aA][gG][fF]")) if place.is_dir() else [place]:
                if path.suffix.lower() == ".agf" and key in self._agf_glasses(path):
                    return self._agf_glasses(path)[key]
            paths = self._yaml_paths(place).get(key, [])
            if paths:
                by_maker = [path for path in paths if maker and maker.lower() in str(path.parent).lower()]
                path = (by_maker or paths)[0]
                with errors_of_file(path, "a glass", LensError):
                    return read_yaml_glass(path)
        try:
            return make_glass(_table_name(name))
        except LensError:
            return _MATERIALS.get(key)

    def _agf_glasses(self, path: Path) -> dict[str, Glass]:
        if path not in self._agf:
            with errors_of_file(path, "a glass catalogue", LensError):
                self._agf[path] = read_agf(path)
        return self._agf[path]

    def _yaml_paths(self, place: Path) -> dict[str, list[Path]]:
        if place not in self._yaml:
            files: Iterable[Path] = sorted(place.rglob("*.yml")) if place.is_dir() else [place]
            table: dict[str, list[Path]] = {}
            for path in files:
                if path.suffix.lower() in (".yml", ".yaml"):
                    table.setdefault(plain_name(path.stem), []).append(path)
            self._yaml[place] = table
        return self._yaml[place]


def plain_name(name: str) -> str:
    """Return the name without case, dashes and blanks."""
    return re.sub(r"[^A-Z0-9]", "", name.upper())


def _table_name(name: str) -> str:
    """Return a name as the table of this package spells it."""
    name = name.upper()
    return f"N-{name[1:]}" if name.startswith("N") and not name.startswith("N-") else name


def read_agf(path: Path) -> dict[str, Glass]:
    """Read a Zemax glass catalogue; ignores glasses with unknown formulas.

    Raises:
        LensError: The file cannot be read, or a number is invalid.

    Source:
        The formulas of "OpticStudio user manual", glass catalogs, 1 to 13; wavelengths in micrometres.
    """
    glasses: dict[str, Glass] = {}
    name, kind = "", 0
    for number, line in enumerate(read_lines(path), start=1):
        key, _, rest = line.strip().partition(" ")
        try:
            if key == "NM":
                words = rest.split()
                name, kind = words[0], int(float(words[1]))
            elif key == "CD" and name:
                glass = _agf_formula(kind, [float(word) for word in rest.split()])
                if glass is not None:
                    glasses[plain_name(name)] = glass
        except (ValueError, IndexError) as error:
            raise LensError(f"{path}, line {number}: {key}: expected numbers: {error}") from error
    return glasses


def _agf_formula(kind: int, numbers: list[float]) -> FormulaGlass | None:
    c = [*numbers, *[0.0] * 12]
    pairs: _Powers
    if kind == 1:
        pairs = ((c[0], 0), (c[1], 2), (c[2], -2), (c[3], -4), (c[4], -6), (c[5], -8))
        return FormulaGlass(powers=pairs)
    if kind in (2, 6, 11):
        count = {2: 3, 6: 4, 11: 5}[kind]
        poles = tuple((c[2 * i], 2.0, c[2 * i + 1], 1.0) for i in range(count) if c[2 * i])
        return FormulaGlass(powers=((1.0, 0.0),), poles=poles)
    if kind == 3:
        poles = ((c[1], 0.0, 0.028, 1.0), (c[2], 0.0, 0.028, 2.0))
        return FormulaGlass(root=1.0, powers=((c[0], 0), (c[3], 2), (c[4], 4), (c[5], 6)), poles=poles)
    if kind == 4:
        poles = ((c[1], 2.0, c[2] ** 2, 1.0), (c[3], 0.0, c[4] ** 2, 1.0))
        return FormulaGlass(powers=((1 + c[0], 0),), poles=poles)
    if kind == 5:
        return FormulaGlass(root=1.0, powers=((c[0], 0), (c[1], -1), (c[2], -3.5)))
    if kind in (7, 8):
        q = 0.0 if kind == 7 else 2.0
        return FormulaGlass(powers=((c[0], 0), (-c[3], 2)), poles=((c[1], q, c[2], 1.0),))
    if kind == 9:
        return FormulaGlass(powers=((c[0], 0),), poles=((c[1], 2.0, c[2], 1.0), (c[3], 2.0, c[4], 1.0)))
    powers = {
        10: (0, 2, -2, -4, -6, -8, -10, -12),
        12: (0, 2, -2, -4, -6, -8, 4, 6),
        13: (0, 2, 4, -2, -4, -6, -8, -10, -12),
    }.get(kind)
    if powers is None:
        return None
    return FormulaGlass(powers=tuple((a, float(p)) for a, p in zip(c, powers, strict=False) if a))


def read_yaml_glass(path: Path) -> Glass:
    """Read one material of refractiveindex.info, its first formula or table of n.

    Raises:
        LensError: The file cannot be read, or has no known formula.
    """
    table: list[list[float]] = []
    kind, reading = "", False
    for number, line in enumerate(read_lines(path), start=1):
        text = line.strip()
        if match := re.match(r"- type:\s*(.+)", text):
            if table:
                break
            kind, reading = match[1].strip(), False
        elif text.startswith("coefficients:") and kind.startswith("formula"):
            try:
                numbers = [float(word) for word in text.partition(":")[2].split()]
                return _info_formula(int(kind.split()[1]), numbers)
            except (ValueError, IndexError, LensError) as error:
                raise LensError(f"{path}, line {number}: coefficients: {error}") from error
        elif text.startswith("data:"):
            reading = kind in ("tabulated n", "tabulated nk")
        elif reading and text:
            try:
                table.append([float(word) for word in text.split()[:2]])
            except ValueError:
                reading = False
    if len(table) < 2:
        raise LensError(f"{path}: DATA: expected a formula or a table of n, got neither")
    wavelengths, indices = zip(*sorted(table), strict=True)
    return TableGlass(wavelengths=tuple(1000 * w for w in wavelengths), indices=tuple(indices))


def _info_formula(kind: int, c: list[float]) -> FormulaGlass:
    def pairs(start: int) -> list[tuple[float, float]]:
        return [(c[i], c[i + 1]) for i in range(start, len(c) - 1, 2)]

    if kind in (1, 2):
        poles = tuple((b, 2.0, pole**2 if kind == 1 else pole, 1.0) for b, pole in pairs(1))
        return FormulaGlass(powers=((1 + c[0], 0.0),), poles=poles)
    if kind in (3, 5):
        return FormulaGlass(root=2.0 if kind == 3 else 1.0, powers=((c[0], 0.0), *pairs(1)))
    if kind == 4:
        poles = tuple((c[i], c[i + 1], c[i + 2] ** c[i + 3], 1.0) for i in (1, 5) if len(c) > i + 3 and c[i])
        return FormulaGlass(powers=((c[0], 0.0), *pairs(9)), poles=poles)
    if kind == 7:
        poles = ((c[1], 0.0, 0.028, 1.0), *(((c[2], 0.0, 0.028, 2.0),) if len(c) > 2 else ()))
        return FormulaGlass(
            root=1.0,
            powers=((c[0], 0.0), *((a, 2.0 * i + 2) for i, a in enumerate(c[3:]))),
            poles=poles,
        )
    raise LensError(f"formula {kind} is not known; 1 to 5 and 7 are")


def approximate(nd: float, vd: float) -> Glass:
    """Return an approximation of a glass by index and Abbe number; Vd 0 is no dispersion."""
    return AbbeGlass(nd, vd) if vd > 0 else FormulaGlass(root=1.0, powers=((nd, 0.0),))

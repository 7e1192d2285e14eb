"""The door of this room: a lens file of any known format to a prescription."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from bokehnet.errors import LensError
from bokehnet.lenses.files.codev import read_codev
from bokehnet.lenses.files.glasses import GlassCatalogues
from bokehnet.lenses.files.lentil import read_lentil
from bokehnet.lenses.files.optiland import read_optiland
from bokehnet.lenses.files.oslo import read_oslo
from bokehnet.lenses.files.rayoptics import read_rayoptics
from bokehnet.lenses.files.structure import FARTHEST, FileLens, to_prescription
from bokehnet.lenses.files.table import read_table
from bokehnet.lenses.files.zemax import read_zemax
from bokehnet.lenses.prescription_file import Prescription

__all__ = ["LENS_FILES", "ImportedLens", "import_lens", "is_lens_file"]

_Reader = Callable[[Path, GlassCatalogues], FileLens]

# Endings, and who reads them.
LENS_FILES: dict[str, _Reader] = {
    ".zmx": read_zemax,
    ".seq": read_codev,
    ".len": read_oslo,
    ".json": read_optiland,
    ".roa": read_rayoptics,
    ".csv": read_table,
    ".fx": read_lentil,
}


@dataclass(frozen=True, kw_only=True, slots=True)
class ImportedLens:
    """A lens of a file.

    Attributes:
        prescription: In mm.
        said: What was taken for granted, a sentence each.
        skipped: Commands that were passed over, and how often.
        millimetres: Of the file's unit of length.
        object_distance: mm in front of the first surface; infinite where it is farther than 1e9 mm.
        field_is_angle: Whether the file tells its field by an angle above 0.
    """

    prescription: Prescription
    said: tuple[str, ...]
    skipped: dict[str, int]
    millimetres: float = 1.0
    object_distance: float = math.inf
    field_is_angle: bool = False


def is_lens_file(path: str | Path) -> bool:
    """Whether the ending is one of a lens file, with a position or without."""
    return _position(Path(path))[0].suffix.lower() in LENS_FILES


def _position(path: Path) -> tuple[Path, int | None]:
    """Path and position of ``lens.zmx@2``; None where none is told."""
    name, mark, told = path.name.rpartition("@")
    return (path.with_name(name), int(told)) if mark and name and told.isdigit() else (path, None)


def import_lens(path: str | Path, glasses: Sequence[str | Path] = ()) -> ImportedLens:
    """Read a lens file of another program, told by its ending.

    Args:
        path: ``.zmx`` (Zemax), ``.seq`` (CODE V), ``.len`` (OSLO), ``.json`` (optiland), ``.roa``
            (ray-optics), ``.csv`` (a table of R, d, n, V) or ``.fx`` (lentil). ``lens.fx@2`` is the second
            position of a zoom; without a number it is the first.
        glasses: Catalogues: AGF files, refractiveindex.info's YAML, folders of either. Those in the folder of
            the lens file are looked at last.

    Raises:
        LensError: The file cannot be read, or describes no lens that can be traced here; it names file, line
            and key.
    """
    path, position = _position(Path(path))
    reader = LENS_FILES.get(path.suffix.lower())
    if reader is None:
        raise LensError(f"{path}: expected a lens file that ends in {', '.join(LENS_FILES)}")
    beside = sorted(path.parent.glob("*.[aA][gG][fF]"))
    lens = reader(path, GlassCatalogues((*map(Path, glasses), *beside)))
    count = len(lens.positions)
    lens = lens.at(1 if position is None else position)
    if count > 1 and position is None:
        lens.said.append(f"the first of {count} positions; others are {path.name}@2 to {path.name}@{count}")
    prescription = to_prescription(lens)
    distance = lens.surfaces[0].thickness * lens.millimetres
    return ImportedLens(
        prescription=prescription,
        said=tuple(lens.said),
        skipped=dict(lens.skipped),
        millimetres=lens.millimetres,
        object_distance=distance if abs(distance) < FARTHEST else math.inf,
        field_is_angle=lens.field is not None and lens.field[0] == "angle" and lens.field[1] > 0,
    )

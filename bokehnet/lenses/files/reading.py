"""Import of lens files: any known format to a prescription. Entry point of this package."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from bokehnet.errors import LensError, errors_of_file
from bokehnet.lenses.files.codev import read_codev
from bokehnet.lenses.files.glass.glasses import GlassCatalogues
from bokehnet.lenses.files.lentil import read_lentil
from bokehnet.lenses.files.optiland import read_optiland
from bokehnet.lenses.files.oslo import read_oslo
from bokehnet.lenses.files.rayoptics import read_rayoptics
from bokehnet.lenses.files.structure import MAX_OBJECT_DISTANCE, FileLens, to_prescription
from bokehnet.lenses.files.table import read_table
from bokehnet.lenses.files.zemax import read_zemax
from bokehnet.lenses.prescription_file import Prescription

__all__ = ["LENS_FILES", "ImportedLens", "import_lens", "is_lens_file"]

_Reader = Callable[[Path, GlassCatalogues], FileLens]

# Readers by file suffix.
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
    """Imported lens.

    Attributes:
        prescription: Prescription, in mm.
        notes: Assumptions of the import, a sentence each.
        skipped: Ignored commands, with their counts.
        millimetres: Millimetres per unit of length of the file.
        object_distance: Distance of the object in front of the first surface, mm; infinite beyond 1e9 mm.
        field_is_angle: True if the file gives its field by an angle above 0.
    """

    prescription: Prescription
    notes: tuple[str, ...]
    skipped: dict[str, int]
    millimetres: float = 1.0
    object_distance: float = math.inf
    field_is_angle: bool = False


def is_lens_file(path: str | Path) -> bool:
    """Return whether the suffix is that of a lens file, with or without a position."""
    return _split_position(Path(path))[0].suffix.lower() in LENS_FILES


def _split_position(path: Path) -> tuple[Path, int | None]:
    """Return path and position of ``lens.zmx@2``; the position is None if absent."""
    name, mark, digits = path.name.rpartition("@")
    return (path.with_name(name), int(digits)) if mark and name and digits.isdigit() else (path, None)


def import_lens(path: str | Path, glasses: Sequence[str | Path] = ()) -> ImportedLens:
    """Read a lens file of another program, identified by its suffix.

    Args:
        path: ``.zmx`` (Zemax), ``.seq`` (CODE V), ``.len`` (OSLO), ``.json`` (optiland), ``.roa``
            (ray-optics), ``.csv`` (a table of R, d, n, V) or ``.fx`` (lentil). ``lens.fx@2`` is the second
            position of a zoom; without a number it is the first.
        glasses: Catalogues: AGF files, refractiveindex.info YAML, folders of either. AGF files in the folder
            of the lens file are searched last.

    Raises:
        LensError: The file cannot be read, or describes no lens that can be traced; the message names file,
            line and key.
    """
    path, position = _split_position(Path(path))
    reader = LENS_FILES.get(path.suffix.lower())
    if reader is None:
        raise LensError(f"{path}: expected a lens file that ends in {', '.join(LENS_FILES)}")
    local_catalogues = sorted(path.parent.glob("*.[aA][gG][fF]"))
    catalogues = GlassCatalogues((*map(Path, glasses), *local_catalogues))
    with errors_of_file(path, "a lens", LensError):
        lens = reader(path, catalogues)
        count = len(lens.positions)
        lens = lens.at(1 if position is None else position)
        if count > 1 and position is None:
            others = f"{path.name}@2 to {path.name}@{count}"
            lens.notes.append(f"the first of {count} positions; others are {others}")
        prescription = to_prescription(lens)
    distance = lens.surfaces[0].thickness * lens.millimetres
    return ImportedLens(
        prescription=prescription,
        notes=tuple(lens.notes),
        skipped=dict(lens.skipped),
        millimetres=lens.millimetres,
        object_distance=distance if abs(distance) < MAX_OBJECT_DISTANCE else math.inf,
        field_is_angle=lens.field is not None and lens.field[0] == "angle" and lens.field[1] > 0,
    )

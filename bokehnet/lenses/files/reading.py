"""The door of this room: a lens file of any known format to a prescription."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from bokehnet.errors import LensError
from bokehnet.lenses.files.codev import read_codev
from bokehnet.lenses.files.glasses import GlassCatalogues
from bokehnet.lenses.files.optiland import read_optiland
from bokehnet.lenses.files.oslo import read_oslo
from bokehnet.lenses.files.rayoptics import read_rayoptics
from bokehnet.lenses.files.structure import FileLens, to_prescription
from bokehnet.lenses.files.table import read_table
from bokehnet.lenses.files.zemax import read_zemax
from bokehnet.lenses.prescription_file import Prescription

__all__ = ["LENS_FILES", "ImportedLens", "import_lens"]

_Reader = Callable[[Path, GlassCatalogues], FileLens]

# Endings, and who reads them.
LENS_FILES: dict[str, _Reader] = {
    ".zmx": read_zemax,
    ".seq": read_codev,
    ".len": read_oslo,
    ".json": read_optiland,
    ".roa": read_rayoptics,
    ".csv": read_table,
}


@dataclass(frozen=True, kw_only=True, slots=True)
class ImportedLens:
    """A lens of a file.

    Attributes:
        prescription: In mm.
        said: What was taken for granted, a sentence each.
        skipped: Commands that were passed over, and how often.
    """

    prescription: Prescription
    said: tuple[str, ...]
    skipped: dict[str, int]


def import_lens(path: str | Path, glasses: Sequence[str | Path] = ()) -> ImportedLens:
    """Read a lens file of another program, told by its ending.

    Args:
        path: ``.zmx`` (Zemax), ``.seq`` (CODE V), ``.len`` (OSLO), ``.json`` (optiland), ``.roa``
            (ray-optics) or ``.csv`` (a table of R, d, n, V).
        glasses: Catalogues: AGF files, refractiveindex.info's YAML, folders of either. Those in the folder of
            the lens file are looked at last.

    Raises:
        LensError: The file cannot be read, or describes no lens that can be traced here; it names file, line
            and key.
    """
    path = Path(path)
    reader = LENS_FILES.get(path.suffix.lower())
    if reader is None:
        raise LensError(f"{path}: expected a lens file that ends in {', '.join(LENS_FILES)}")
    beside = sorted(path.parent.glob("*.[aA][gG][fF]"))
    lens = reader(path, GlassCatalogues((*map(Path, glasses), *beside)))
    prescription = to_prescription(lens)
    return ImportedLens(prescription=prescription, said=tuple(lens.said), skipped=dict(lens.skipped))

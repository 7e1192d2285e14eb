"""Sheet of point spread functions: ray-traced ones beside those of the lens's aberration map."""

from pathlib import Path

import numpy as np

from bokehnet.io.image import write_image
from bokehnet.lenses.aberrations.psf_pairs import FIELDS, PsfPair, psf_pairs
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.progress import Progress
from bokehnet.tools.contact_sheet import contact_sheet

__all__ = ["write_psf_sheet"]

_SCALE = 4  # pixels of the sheet per cell
_GAP_PX = 6  # between the two functions
_DEPTHS = 3
_EXPOSURE_QUANTILE = 0.995  # fraction of the lit cells that are not clipped


def write_psf_sheet(lens: PrescriptionLens, path: Path, report: Progress | None = None) -> list[PsfPair]:
    """Write the sheet, depths as rows and fields as columns, and return its pairs.

    Args:
        lens: Lens.
        path: Picture file.
        report: Progress callback, counting points.

    Raises:
        ImageFileError: The file cannot be written.
        LensError: A corner of the picture receives no light.

    Examples:
        >>> from dataclasses import replace
        >>> from bokehnet.lenses.catalog import load_lens
        >>> lens = load_lens("biconvex")
        >>> wide = replace(lens.prescription, image_radius=300.0)  # mm, far too large
        >>> write_psf_sheet(replace(lens, prescription=wide), Path("sheet.png"))
        Traceback (most recent call last):
            ...
        bokehnet.errors.LensError: Biconvex singlet: rays through the middle of the stop cross in the picture
    """
    count = _DEPTHS * len(FIELDS)
    pairs = []
    for pair in psf_pairs(lens):
        pairs.append(pair)
        if report is not None:
            report(len(pairs), count)
    cells = [(_label(pair), _panel(pair)) for pair in pairs]
    rows = [cells[first : first + len(FIELDS)] for first in range(0, count, len(FIELDS))]
    write_image(path, contact_sheet(rows))
    return pairs


def _panel(pair: PsfPair) -> np.ndarray:
    """Return the traced function on the left and the reduced one on the right, in one exposure."""
    lit = pair.traced[pair.traced > 0.01 * pair.traced.max()]
    exposure = 1 / np.quantile(lit, _EXPOSURE_QUANTILE)
    sides = [np.kron(exposure * psf, np.ones((_SCALE, _SCALE, 1))) for psf in (pair.traced, pair.reduced)]
    gap = np.full((len(sides[0]), _GAP_PX, 3), 0.1)
    return np.concatenate([sides[0], gap, sides[1]], axis=1).astype(np.float32)


def _label(pair: PsfPair) -> str:
    position = f"{pair.depth / 1000:.4g} m, field {pair.field:g}"
    return f"{position}, {100 * pair.width:.2g} % wide, match {pair.correlation:.3f}"

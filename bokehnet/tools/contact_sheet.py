"""Contact sheets: pictures side by side, each with a label under it."""

from collections.abc import Sequence

import numpy as np
import OpenImageIO as oiio  # noqa: N813

from bokehnet.errors import ShapeError

__all__ = ["contact_sheet"]

_GAP = 12  # pixels between pictures and around them
_STRIP = 34  # pixels under a picture for its label
_FONT_SIZE = 22
_PAPER = 0.012  # linear grey
_INK = 0.75


def contact_sheet(rows: Sequence[Sequence[tuple[str, np.ndarray]]]) -> np.ndarray:
    """Lay labelled pictures out in centred rows.

    Args:
        rows: Rows of (label, picture); pictures are scene-linear, (H, W, 3), all of one size.

    Returns:
        The sheet, scene-linear float32, (H', W', 3).

    Raises:
        ShapeError: The pictures differ in size.
    """
    sizes = {picture.shape for row in rows for _, picture in row}
    if len(sizes) != 1:
        raise ShapeError(f"contact sheet: expected pictures of one size, got {sorted(sizes)}")
    height, width, _ = sizes.pop()
    columns = max(len(row) for row in rows)
    step_y, step_x = height + _STRIP + _GAP, width + _GAP
    sheet = np.full((_GAP + len(rows) * step_y, _GAP + columns * step_x, 3), _PAPER, np.float32)
    for index, row in enumerate(rows):
        top = _GAP + index * step_y
        first = _GAP + (columns - len(row)) * step_x // 2
        for left, (label, picture) in zip(range(first, sheet.shape[1], step_x), row, strict=False):
            sheet[top : top + height, left : left + width] = picture
            sheet[top + height : top + height + _STRIP, left : left + width] = _text_strip(label, width)
    return sheet


def _text_strip(text: str, width: int) -> np.ndarray:
    """Return ``text`` on paper, (_STRIP, width, 3); the font is one that OpenImageIO brings along."""
    strip = oiio.ImageBuf(np.full((_STRIP, width, 3), _PAPER, np.float32))
    if not oiio.ImageBufAlgo.render_text(strip, 2, _STRIP - 10, text, _FONT_SIZE, "", (_INK,) * 3):
        raise RuntimeError(f"cannot draw text: {strip.geterror()}")
    return np.asarray(strip.get_pixels(oiio.FLOAT)).reshape(_STRIP, width, 3)

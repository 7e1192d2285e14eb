"""Contact sheets: pictures side by side, with a label under each."""

from collections.abc import Sequence

import numpy as np
import OpenImageIO as oiio  # noqa: N813

from bokehnet.errors import ShapeError

__all__ = ["contact_sheet"]

_GAP_PX = 12  # between pictures and around them
_LABEL_HEIGHT_PX = 34
_FONT_SIZE = 22
_BACKGROUND = 0.012  # linear grey
_INK = 0.75


def contact_sheet(rows: Sequence[Sequence[tuple[str, np.ndarray]]]) -> np.ndarray:
    """Arrange labelled pictures in centred rows.

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
    step_y, step_x = height + _LABEL_HEIGHT_PX + _GAP_PX, width + _GAP_PX
    sheet = np.full((_GAP_PX + len(rows) * step_y, _GAP_PX + columns * step_x, 3), _BACKGROUND, np.float32)
    for index, row in enumerate(rows):
        top = _GAP_PX + index * step_y
        first = _GAP_PX + (columns - len(row)) * step_x // 2
        for left, (label, picture) in zip(range(first, sheet.shape[1], step_x), row, strict=False):
            sheet[top : top + height, left : left + width] = picture
            bottom = top + height
            sheet[bottom : bottom + _LABEL_HEIGHT_PX, left : left + width] = _label(label, width)
    return sheet


def _label(text: str, width: int) -> np.ndarray:
    """Return ``text`` on the background, (_LABEL_HEIGHT_PX, width, 3), in the font of OpenImageIO."""
    strip = oiio.ImageBuf(np.full((_LABEL_HEIGHT_PX, width, 3), _BACKGROUND, np.float32))
    if not oiio.ImageBufAlgo.render_text(strip, 2, _LABEL_HEIGHT_PX - 10, text, _FONT_SIZE, "", (_INK,) * 3):
        raise RuntimeError(f"cannot draw text: {strip.geterror()}")
    return np.asarray(strip.get_pixels(oiio.FLOAT)).reshape(_LABEL_HEIGHT_PX, width, 3)

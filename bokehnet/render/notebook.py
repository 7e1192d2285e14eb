"""HTML of a result for notebooks: picture and report."""

import base64
import html
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.io.image import write_image

__all__ = ["picture_url", "shown_html"]

_MAX_WIDTH_PX = 960


def picture_url(image: npt.NDArray[np.float32]) -> str:
    """Return a picture as a ``data:`` URL of a JPEG, reduced by an integer factor to at most 960 columns.

    Args:
        image: Scene-linear Rec.709, (H, W, 3).

    Examples:
        >>> picture_url(np.ones((8, 8, 3), np.float32))[:23]
        'data:image/jpeg;base64,'
    """
    step = -(-image.shape[1] // _MAX_WIDTH_PX)
    height, width = (max(side // step, 1) for side in image.shape[:2])
    cropped = image[: height * step, : width * step]
    small = cropped.reshape(height, -1, width, cropped.shape[1] // width, 3).mean((1, 3), dtype=np.float32)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shown.jpg"
        write_image(path, small, quality=92)
        coded = base64.b64encode(path.read_bytes()).decode("ascii")
    return f"data:image/jpeg;base64,{coded}"


def shown_html(image: npt.NDArray[np.float32], lines: list[str]) -> str:
    """Return an HTML figure of a picture with lines of text below it.

    Args:
        image: Scene-linear Rec.709, (H, W, 3).
        lines: Plain text.

    Examples:
        >>> shown_html(np.ones((8, 8, 3), np.float32), ["f < 2"]).endswith("f &lt; 2</figcaption></figure>")
        True
    """
    text = "<br>".join(html.escape(line) for line in lines)
    picture = f'<img src="{picture_url(image)}" style="max-width: 100%">'
    return f"<figure>{picture}<figcaption>{text}</figcaption></figure>"

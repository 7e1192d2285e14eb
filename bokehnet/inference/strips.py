"""How a picture is cut into strips that are rendered one after the other, so that memory stays bounded."""

from collections.abc import Iterator

from bokehnet.classical.base import ALIGNED, Strip
from bokehnet.errors import ParameterError

__all__ = ["cut_strips"]

# Bytes that the classical renderers need at most beyond input and output, for each pixel of a strip.
BYTES_PER_PIXEL = {"rays": 125, "scatter": 45}

# Rows around a strip that its result depends on, in units of the blur radius: those that a ray crosses, and
# those from which what they hide is filled. Windows of a few pixels come on top.
_HALO = {"rays": 2, "scatter": 1}
_FEW = 32


def _aligned(row: int) -> int:
    return row // ALIGNED * ALIGNED


def cut_strips(height: int, width: int, reach: int, classical: str, memory: int) -> Iterator[Strip]:
    """Cut a picture into strips, from top to bottom.

    Args:
        height: Of the picture.
        width: Of the picture.
        reach: Its largest blur radius, pixels.
        classical: Name of the classical renderer.
        memory: Bytes that rendering a strip may take beyond input and output.

    Raises:
        ParameterError: Not even the narrowest strip fits.
    """
    halo = _HALO[classical] * min(reach, height) + _FEW
    most = memory // (BYTES_PER_PIXEL[classical] * width)
    rows = height if most >= height else _aligned(most - 2 * halo - ALIGNED)
    if rows < ALIGNED and rows < height:
        least = (2 * halo + 2 * ALIGNED) * width * BYTES_PER_PIXEL[classical]
        raise ParameterError(
            f"max_memory: expected at least {least / 1e6:.0f} MB beyond the pictures themselves, for a "
            f"width of {width} and blur of {reach} pixels, got {memory / 1e6:.0f} MB"
        )
    for top in range(0, height, rows):
        bottom = min(height, top + rows)
        first = _aligned(max(0, top - halo))
        yield Strip(
            first=first,
            last=min(height, bottom + halo),
            height=height,
            reach=reach,
            wanted=slice(top - first, bottom - first),
        )

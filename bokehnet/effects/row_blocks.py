"""Formulas that need only some rows of their result at a time, which bounds the working memory."""

from collections.abc import Callable

import numpy as np

from bokehnet.checks import Array, array_namespace

__all__ = ["in_row_blocks"]


def in_row_blocks(formula: Callable[[slice], Array], like: Array, rows: int) -> Array:
    """Return the picture (..., H, W, C) that ``formula`` computes for its rows, a slice with both ends.

    Args:
        formula: Function of rows of the result that returns these rows, (..., rows, W, C).
        like: Picture of the same shape. For a tensor, all rows are computed at once: autograd keeps all
            intermediate values anyway.
        rows: Rows per block.
    """
    height = like.shape[-3]
    if array_namespace(like) is not np:
        return formula(slice(0, height))
    result = np.empty(like.shape, like.dtype)
    for top in range(0, height, rows):
        block = slice(top, min(top + rows, height))
        result[..., block, :, :] = formula(block)
    return result

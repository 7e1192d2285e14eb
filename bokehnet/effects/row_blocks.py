"""Formulas that need no more than some rows of their result at a time, so that working memory stays small."""

from collections.abc import Callable

import numpy as np

from bokehnet.checks import Array, array_namespace

__all__ = ["in_row_blocks"]


def in_row_blocks(formula: Callable[[slice], Array], like: Array, rows: int) -> Array:
    """Return the picture (..., H, W, C) that ``formula`` gives for its rows, a slice with both ends.

    Args:
        formula: From rows of the result to those rows, (..., rows, W, C).
        like: A picture of the same shape. Where it is a tensor, all rows are made at once: autograd keeps all
            that they are made of anyway.
        rows: How many at a time.
    """
    height = like.shape[-3]
    if array_namespace(like) is not np:
        return formula(slice(0, height))
    result = np.empty(like.shape, like.dtype)
    for top in range(0, height, rows):
        block = slice(top, min(top + rows, height))
        result[..., block, :, :] = formula(block)
    return result

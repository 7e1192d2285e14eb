"""Formulas of single pixels, applied to a block of rows at a time to bound the working memory."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["cut_row_blocks", "in_row_blocks", "make_in_row_blocks"]

# Values per block: they fit the cache and outweigh the cost of a call.
_BLOCK_VALUES = 2**18

# Maximum number of threads, and minimum number of blocks for threads.
_MAX_THREADS = 4


def cut_row_blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Yield the rows of an array (H, ...) in blocks of some hundred thousand values."""
    rows = max(1, _BLOCK_VALUES * shape[0] // max(1, int(np.prod(shape))))
    for top in range(0, shape[0], rows):
        yield slice(top, min(top + rows, shape[0]))


def make_in_row_blocks(
    make: Callable[[slice], NDArray[Any]],
    shape: tuple[int, ...],
    dtype: Any,
    out: NDArray[Any] | None = None,
) -> NDArray[Any]:
    """Return an array that is computed a block of rows at a time, by several threads.

    Args:
        make: Function that returns some of the rows.
        shape: Shape of the array, (H, ...).
        dtype: Type of the array.
        out: Output array; default: a new one.
    """
    result = np.empty(shape, dtype) if out is None else out

    def fill(rows: slice) -> None:
        result[rows] = make(rows)

    blocks = [*cut_row_blocks(shape)]
    if len(blocks) < _MAX_THREADS:
        for rows in blocks:
            fill(rows)
    else:
        with ThreadPoolExecutor(min(_MAX_THREADS, os.cpu_count() or 1)) as pool:
            for _ in pool.map(fill, blocks):
                pass
    return result


def in_row_blocks(
    formula: Callable[[NDArray[Any]], NDArray[Any]],
    values: NDArray[Any],
    dtype: Any = None,
    *,
    out: NDArray[Any] | None = None,
) -> NDArray[Any]:
    """Return ``formula(values)`` for a formula that treats all rows equally and keeps the shape.

    Args:
        formula: Function of some rows that returns the same number of rows; called by several threads.
        values: (H, ...).
        dtype: Type of the result; default: that of ``values``.
        out: Output array, may be ``values``; default: a new one.
    """
    return make_in_row_blocks(lambda rows: formula(values[rows]), values.shape, dtype or values.dtype, out)

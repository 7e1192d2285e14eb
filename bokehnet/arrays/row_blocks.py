"""Formulas of single pixels applied a block of rows at a time, so that their working memory stays small."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["cut_row_blocks", "in_row_blocks", "make_in_row_blocks"]

# Values of a block: few enough to stay in the cache, enough to be worth a call.
_VALUES = 2**18

# Threads at most, and blocks from which on they are worth starting.
_WORTH_THREADS = 4


def cut_row_blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Return the rows of an array (H, ...) in blocks of some hundred thousand values."""
    rows = max(1, _VALUES * shape[0] // max(1, int(np.prod(shape))))
    for top in range(0, shape[0], rows):
        yield slice(top, min(top + rows, shape[0]))


def make_in_row_blocks(
    make: Callable[[slice], NDArray[Any]],
    shape: tuple[int, ...],
    dtype: Any,
    out: NDArray[Any] | None = None,
) -> NDArray[Any]:
    """Return an array that is made a block of rows at a time, by several threads.

    Args:
        make: Gives some of the rows.
        shape: Of the array, (H, ...).
        dtype: Of the array.
        out: The array, in place of a new one.
    """
    result = np.empty(shape, dtype) if out is None else out

    def fill(rows: slice) -> None:
        result[rows] = make(rows)

    blocks = [*cut_row_blocks(shape)]
    if len(blocks) < _WORTH_THREADS:
        for rows in blocks:
            fill(rows)
    else:
        with ThreadPoolExecutor(min(_WORTH_THREADS, os.cpu_count() or 1)) as pool:
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
    """Return ``formula(values)`` for a formula that treats every row alike and keeps the shape.

    Args:
        formula: Takes some rows and returns as many; called by several threads.
        values: (H, ...).
        dtype: Of the result; by default that of ``values``.
        out: Where the result goes, in place of a new array; it may be ``values``.
    """
    return make_in_row_blocks(lambda rows: formula(values[rows]), values.shape, dtype or values.dtype, out)

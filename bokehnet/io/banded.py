"""Formulas of single pixels applied a band of rows at a time, so that their working memory stays small."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["in_bands"]

_ROWS = 256


def in_bands(
    formula: Callable[[NDArray[Any]], NDArray[Any]], values: NDArray[Any], dtype: Any = None
) -> NDArray[Any]:
    """Return ``formula(values)`` for a formula that treats every row alike and keeps the shape.

    Args:
        formula: Takes some rows and returns as many.
        values: (H, ...).
        dtype: Of the result; by default that of ``values``.
    """
    result = np.empty(values.shape, dtype or values.dtype)
    for top in range(0, len(values), _ROWS):
        rows = slice(top, top + _ROWS)
        result[rows] = formula(values[rows])
    return result

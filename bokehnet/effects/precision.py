"""Precision of results: that of the picture, though effects are computed in float64."""

import numpy as np

from bokehnet.checks import Array, array_namespace

__all__ = ["cast_like"]


def cast_like(values: Array, image: Array) -> Array:
    """Return ``values`` in the precision of ``image``; both arrays, or both tensors."""
    return values.astype(image.dtype) if array_namespace(image) is np else values.to(image.dtype)

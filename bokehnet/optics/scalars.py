"""Parameters of a formula: floats, or tensors without dimensions that an optimizer adjusts."""

import numpy as np

from bokehnet.checks import Array, array_namespace

__all__ = ["is_absent", "value_of", "without_gradient"]


def without_gradient(x: Array) -> Array:
    """Return ``x`` detached from its gradient graph; arrays and floats unchanged."""
    return x if array_namespace(x) is np else x.detach()


def value_of(number: Array) -> float:
    """Return ``number`` as a float."""
    return float(without_gradient(number))


def is_absent(strength: Array) -> bool:
    """Return whether an effect of this strength can be skipped: it is 0 and not a tensor."""
    return array_namespace(strength) is np and bool(strength == 0)

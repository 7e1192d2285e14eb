"""Numbers of a formula that may be floats, or tensors without dimensions that are to be found by training."""

import numpy as np

from bokehnet.checks import Array, array_namespace

__all__ = ["is_absent", "value_of", "without_gradient"]


def without_gradient(x: Array) -> Array:
    """Return ``x`` outside of the graph of its gradient; what is no tensor, as it is."""
    return x if array_namespace(x) is np else x.detach()


def value_of(number: Array) -> float:
    """Return a float."""
    return float(without_gradient(number))


def is_absent(strength: Array) -> bool:
    """Whether an effect of this strength can be left out: a 0 that is no tensor."""
    return array_namespace(strength) is np and bool(strength == 0)

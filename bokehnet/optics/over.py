"""Light through layers over one another, front to back.

Source:
    Porter and Duff, "Compositing digital images", SIGGRAPH 1984: the operator "over".
"""

from bokehnet.checks import Array, array_namespace

__all__ = ["light_through"]


def light_through(coverage: Array) -> tuple[Array, Array]:
    """Return the share of light that passes each layer and all before it, and that which passes those alone.

    The second times its coverage is how much of a layer is seen.

    Args:
        coverage: Of the layers, 0 to 1, (..., L), NumPy array or torch tensor.

    Returns:
        Both, (..., L).

    Examples:
        >>> import numpy as np
        >>> through, ahead = light_through(np.array([0.5, 0.5, 1.0]))
        >>> through.tolist(), ahead.tolist()
        ([0.5, 0.25, 0.0], [1.0, 0.5, 0.25])
    """
    xp = array_namespace(coverage)
    through = xp.cumprod(1 - coverage, -1)
    return through, xp.concatenate([xp.ones_like(through[..., :1]), through[..., :-1]], -1)

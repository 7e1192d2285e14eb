"""Transmittance of layers ordered front to back.

Source:
    Porter and Duff, "Compositing digital images", SIGGRAPH 1984: the operator "over".
"""

from bokehnet.checks import Array, array_namespace

__all__ = ["transmittance"]


def transmittance(coverage: Array) -> tuple[Array, Array]:
    """Return the inclusive and exclusive products of (1 - coverage), front to back.

    The visible fraction of a layer is its exclusive product times its coverage.

    Args:
        coverage: Coverage of the layers, 0 to 1, (..., L), NumPy array or torch tensor.

    Returns:
        Transmittance of the layers up to and including each, and up to but excluding each, both (..., L).

    Examples:
        >>> import numpy as np
        >>> inclusive, exclusive = transmittance(np.array([0.5, 0.5, 1.0]))
        >>> inclusive.tolist(), exclusive.tolist()
        ([0.5, 0.25, 0.0], [1.0, 0.5, 0.25])
    """
    xp = array_namespace(coverage)
    inclusive = xp.cumprod(1 - coverage, -1)
    return inclusive, xp.concatenate([xp.ones_like(inclusive[..., :1]), inclusive[..., :-1]], -1)

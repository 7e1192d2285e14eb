"""sRGB transfer function in both directions, and the luminance of its primaries."""

from bokehnet.checks import Array, array_namespace

__all__ = ["linear_to_srgb", "luminance", "srgb_to_linear"]

# IEC 61966-2-1: a linear segment through black, then a power law with an offset.
_SLOPE = 12.92
_OFFSET = 0.055
_EXPONENT = 2.4
_ENCODED_KNEE = 0.04045
_LINEAR_KNEE = 0.0031308

# Rec.709 primaries, which sRGB shares.
_LUMINANCE = (0.2126, 0.7152, 0.0722)


def srgb_to_linear(encoded: Array) -> Array:
    """Decode sRGB values to scene-linear light.

    The function is odd (negative values are mirrored), and values above 1 follow the same power law, so
    nothing is clipped. It is differentiable everywhere except at the knee, where the slopes differ by 2 %.

    Args:
        encoded: sRGB values of any shape, floating point, NumPy array, torch tensor or float; 1 is white.

    Returns:
        Linear values of the same shape and dtype; 1 is white.

    Source: IEC 61966-2-1, "Default RGB colour space - sRGB", 1999.
    """
    xp = array_namespace(encoded)
    size = xp.clip(abs(encoded), _ENCODED_KNEE, None)
    curve = ((size + _OFFSET) / (1 + _OFFSET)) ** _EXPONENT
    return xp.where(abs(encoded) <= _ENCODED_KNEE, encoded / _SLOPE, xp.sign(encoded) * curve)


def linear_to_srgb(linear: Array) -> Array:
    """Encode scene-linear light as sRGB; the inverse of :func:`srgb_to_linear`, also odd and unclipped.

    Args:
        linear: Linear values of any shape, floating point, NumPy array, torch tensor or float; 1 is white.

    Returns:
        sRGB values of the same shape and dtype; 1 is white.

    Source: IEC 61966-2-1, "Default RGB colour space - sRGB", 1999.
    """
    xp = array_namespace(linear)
    # The power law has infinite slope at 0: the clip keeps it out of the gradient of the linear branch.
    size = xp.clip(abs(linear), _LINEAR_KNEE, None)
    curve = (1 + _OFFSET) * size ** (1 / _EXPONENT) - _OFFSET
    return xp.where(abs(linear) <= _LINEAR_KNEE, linear * _SLOPE, xp.sign(linear) * curve)


def luminance(linear: Array) -> Array:
    """Return the luminance (CIE Y), (...), of scene-linear colours (..., 3); white is 1.

    Source: ITU-R BT.709-6, "Parameter values for the HDTV standards", 2015, item 3.2.
    """
    red, green, blue = _LUMINANCE
    return red * linear[..., 0] + green * linear[..., 1] + blue * linear[..., 2]

"""FLIP: how visible the differences are when one picture takes the place of the other."""

import math

import numpy as np

from bokehnet.checks import check_above, check_image, check_same_size

__all__ = ["flip_map"]

# Linear sRGB to XYZ, IEC 61966-2-1.
_TO_XYZ = np.array(
    [
        [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
        [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
        [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
    ]
)
_WHITE = _TO_XYZ.sum(axis=1)

# Contrast sensitivity of Y, Cx and Cz: weights and widths (square degrees) of two Gaussians each.
_SENSITIVITY = (
    ((1.0, 0.0047), (0.0, 1e-5)),
    ((1.0, 0.0053), (0.0, 1e-5)),
    ((34.1, 0.04), (13.5, 0.025)),
)

# Powers of colour and feature differences; where colour errors bend, and up to which value.
_COLOUR_POWER, _FEATURE_POWER, _BEND, _BEND_VALUE = 0.7, 0.5, 0.4, 0.95

_FEATURE_WIDTH = 0.082  # degrees


def _linear(srgb: np.ndarray) -> np.ndarray:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0.04045) + 0.055) / 1.055) ** 2.4)


def _to_opponent(linear: np.ndarray) -> np.ndarray:
    """Linear RGB to YCxCz, a linear L*a*b*."""
    x, y, z = np.moveaxis(linear @ _TO_XYZ.T / _WHITE, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def _from_opponent(values: np.ndarray) -> np.ndarray:
    y = (values[..., 0] + 16) / 116
    xyz = np.stack([values[..., 1] / 500 + y, y, y - values[..., 2] / 200], axis=-1) * _WHITE
    return np.asarray(xyz @ np.linalg.inv(_TO_XYZ).T)


def _to_hunt_lab(linear: np.ndarray) -> np.ndarray:
    """Linear RGB to L*a*b* whose colours fade with darkness."""
    share = linear @ _TO_XYZ.T / _WHITE
    delta = 6 / 29
    root = np.where(share > delta**3, np.cbrt(np.maximum(share, 0)), share / (3 * delta**2) + 4 / 29)
    lightness = 116 * root[..., 1] - 16
    a, b = 500 * (root[..., 0] - root[..., 1]), 200 * (root[..., 1] - root[..., 2])
    return np.stack([lightness, 0.01 * lightness * a, 0.01 * lightness * b], axis=-1)


def _along(values: np.ndarray, weights: np.ndarray, axis: int) -> np.ndarray:
    """Correlation of (H, W) with a row of weights along an axis, the border repeated."""
    half = len(weights) // 2
    edges = [(half, half) if k == axis else (0, 0) for k in range(2)]
    padded = np.pad(values, edges, mode="edge")
    size = values.shape[axis]
    windows = (np.take(padded, np.arange(k, k + size), axis) * w for k, w in enumerate(weights))
    return np.asarray(sum(windows))


def _blurred(values: np.ndarray, pixels_per_degree: float) -> np.ndarray:
    """YCxCz as the eye resolves it."""
    widest = max(width for pair in _SENSITIVITY for _, width in pair)
    half = math.ceil(3 * math.sqrt(widest / (2 * math.pi**2)) * pixels_per_degree)
    at = np.arange(-half, half + 1) / pixels_per_degree
    found = np.zeros_like(values)
    for channel, pair in enumerate(_SENSITIVITY):
        total = 0.0
        for weight, width in pair:
            if weight == 0:
                continue
            bell = np.exp(-(math.pi**2) * at**2 / width)
            scale = weight * math.sqrt(math.pi / width)
            total += scale * bell.sum() ** 2
            found[..., channel] += scale * _along(_along(values[..., channel], bell, 0), bell, 1)
        found[..., channel] /= total
    return found


def _hyab(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    difference = a - b
    return np.asarray(np.abs(difference[..., 0]) + np.hypot(difference[..., 1], difference[..., 2]))


def _colour_errors(reference: np.ndarray, test: np.ndarray, pixels_per_degree: float) -> np.ndarray:
    seen = [
        _to_hunt_lab(np.clip(_from_opponent(_blurred(x, pixels_per_degree)), 0, 1)) for x in (reference, test)
    ]
    error = _hyab(*seen) ** _COLOUR_POWER
    green, blue = (_to_hunt_lab(np.array(colour)) for colour in ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]))
    largest = _hyab(green, blue) ** _COLOUR_POWER
    bend = _BEND * largest
    above = _BEND_VALUE + (error - bend) / (largest - bend) * (1 - _BEND_VALUE)
    return np.where(error < bend, _BEND_VALUE / bend * error, above)


def _features(lightness: np.ndarray, pixels_per_degree: float) -> list[np.ndarray]:
    """How strong edges and points are."""
    deviation = 0.5 * _FEATURE_WIDTH * pixels_per_degree
    half = math.ceil(3 * deviation)
    at = np.arange(-half, half + 1)
    bell = np.exp(-(at**2) / (2 * deviation**2))
    found = []
    for shape in (-at * bell, (at**2 / deviation**2 - 1) * bell):
        # Of the two-dimensional filter all that is above 0 sums to 1, all that is below to -1.
        above, below = shape[shape > 0].sum() * bell.sum(), -shape[shape < 0].sum() * bell.sum()
        shape = np.where(shape > 0, shape / above, shape / below)
        across = _along(_along(lightness, shape, 1), bell, 0)
        down = _along(_along(lightness, shape, 0), bell, 1)
        found.append(np.hypot(across, down))
    return found


def flip_map(reference: np.ndarray, test: np.ndarray, pixels_per_degree: float = 67.0) -> np.ndarray:
    """How visible the difference is at each pixel, (H, W) in [0, 1]; its mean is the usual score, 0 is best.

    Args:
        reference: As it is shown, sRGB in [0, 1], (H, W, 3).
        test: The same size.
        pixels_per_degree: Of the field of view; 67 is a 0.7 m wide 4K screen at 0.7 m.

    Raises:
        ShapeError: Not (H, W, 3) of one size.
        ParameterError: NaN or infinity, or ``pixels_per_degree`` is not above 0.

    Examples:
        >>> import numpy as np
        >>> grey = np.full((24, 32, 3), 0.5)
        >>> float(flip_map(grey, grey).max())
        0.0

    Source:
        Andersson et al., "FLIP: A difference evaluator for alternating images", Proceedings of the ACM on
        Computer Graphics and Interactive Techniques 2020.
    """
    check_image("reference", reference)
    check_image("test", test)
    check_same_size("reference", reference, "test", test)
    check_above("pixels_per_degree", pixels_per_degree, 0)
    a, b = (_to_opponent(_linear(np.clip(x, 0, 1).astype(np.float64))) for x in (reference, test))
    colour = _colour_errors(a, b, pixels_per_degree)
    wanted, got = (_features((x[..., 0] + 16) / 116, pixels_per_degree) for x in (a, b))
    apart = np.maximum(*(np.abs(p - q) for p, q in zip(wanted, got, strict=True)))
    feature = (apart / math.sqrt(2)) ** _FEATURE_POWER
    return np.asarray(np.clip(colour, 0, 1) ** (1 - np.clip(feature, 0, 1)), np.float32)

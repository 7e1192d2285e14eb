"""FLIP: visibility of the differences between alternating pictures."""

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

# Exponents of colour and feature differences; position and value of the knee of colour errors.
_COLOUR_POWER, _FEATURE_POWER, _KNEE, _KNEE_VALUE = 0.7, 0.5, 0.4, 0.95

_FEATURE_WIDTH = 0.082  # degrees


def _linear(srgb: np.ndarray) -> np.ndarray:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0.04045) + 0.055) / 1.055) ** 2.4)


def _to_opponent(linear: np.ndarray) -> np.ndarray:
    """Convert linear RGB to YCxCz, a linear L*a*b*."""
    x, y, z = np.moveaxis(linear @ _TO_XYZ.T / _WHITE, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def _from_opponent(values: np.ndarray) -> np.ndarray:
    y = (values[..., 0] + 16) / 116
    xyz = np.stack([values[..., 1] / 500 + y, y, y - values[..., 2] / 200], axis=-1) * _WHITE
    return np.asarray(xyz @ np.linalg.inv(_TO_XYZ).T)


def _to_hunt_lab(linear: np.ndarray) -> np.ndarray:
    """Convert linear RGB to L*a*b* with the Hunt effect: chroma decreases with lightness."""
    relative = linear @ _TO_XYZ.T / _WHITE
    delta = 6 / 29
    root = np.where(relative > delta**3, np.cbrt(np.maximum(relative, 0)), relative / (3 * delta**2) + 4 / 29)
    lightness = 116 * root[..., 1] - 16
    a, b = 500 * (root[..., 0] - root[..., 1]), 200 * (root[..., 1] - root[..., 2])
    return np.stack([lightness, 0.01 * lightness * a, 0.01 * lightness * b], axis=-1)


def _correlate(values: np.ndarray, weights: np.ndarray, axis: int) -> np.ndarray:
    """Return the correlation of (H, W) with weights along an axis, border repeated."""
    half = len(weights) // 2
    edges = [(half, half) if k == axis else (0, 0) for k in range(2)]
    padded = np.pad(values, edges, mode="edge")
    size = values.shape[axis]
    windows = (np.take(padded, np.arange(k, k + size), axis) * w for k, w in enumerate(weights))
    return np.asarray(sum(windows))


def _blurred(values: np.ndarray, pixels_per_degree: float) -> np.ndarray:
    """Return YCxCz filtered by the contrast sensitivity of the eye."""
    widest = max(width for pair in _SENSITIVITY for _, width in pair)
    half = math.ceil(3 * math.sqrt(widest / (2 * math.pi**2)) * pixels_per_degree)
    position = np.arange(-half, half + 1) / pixels_per_degree
    result = np.zeros_like(values)
    for channel, pair in enumerate(_SENSITIVITY):
        total = 0.0
        for weight, width in pair:
            if weight == 0:
                continue
            gaussian = np.exp(-(math.pi**2) * position**2 / width)
            scale = weight * math.sqrt(math.pi / width)
            total += scale * gaussian.sum() ** 2
            result[..., channel] += scale * _correlate(
                _correlate(values[..., channel], gaussian, 0), gaussian, 1
            )
        result[..., channel] /= total
    return result


def _hyab(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    difference = a - b
    return np.asarray(np.abs(difference[..., 0]) + np.hypot(difference[..., 1], difference[..., 2]))


def _colour_errors(reference: np.ndarray, test: np.ndarray, pixels_per_degree: float) -> np.ndarray:
    filtered = [
        _to_hunt_lab(np.clip(_from_opponent(_blurred(x, pixels_per_degree)), 0, 1)) for x in (reference, test)
    ]
    error = _hyab(*filtered) ** _COLOUR_POWER
    green, blue = (_to_hunt_lab(np.array(colour)) for colour in ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]))
    largest = _hyab(green, blue) ** _COLOUR_POWER
    knee = _KNEE * largest
    above = _KNEE_VALUE + (error - knee) / (largest - knee) * (1 - _KNEE_VALUE)
    return np.where(error < knee, _KNEE_VALUE / knee * error, above)


def _features(lightness: np.ndarray, pixels_per_degree: float) -> list[np.ndarray]:
    """Return the strengths of edges and of points."""
    deviation = 0.5 * _FEATURE_WIDTH * pixels_per_degree
    half = math.ceil(3 * deviation)
    position = np.arange(-half, half + 1)
    gaussian = np.exp(-(position**2) / (2 * deviation**2))
    result = []
    for shape in (-position * gaussian, (position**2 / deviation**2 - 1) * gaussian):
        # Positive weights of the two-dimensional filter sum to 1, negative weights to -1.
        above, below = shape[shape > 0].sum() * gaussian.sum(), -shape[shape < 0].sum() * gaussian.sum()
        shape = np.where(shape > 0, shape / above, shape / below)
        across = _correlate(_correlate(lightness, shape, 1), gaussian, 0)
        down = _correlate(_correlate(lightness, shape, 0), gaussian, 1)
        result.append(np.hypot(across, down))
    return result


def flip_map(reference: np.ndarray, test: np.ndarray, pixels_per_degree: float = 67.0) -> np.ndarray:
    """Return the visibility of the difference at each pixel, (H, W) in [0, 1]; 0 is best.

    Args:
        reference: Display picture, sRGB in [0, 1], (H, W, 3).
        test: Display picture of the same size.
        pixels_per_degree: Pixels per degree of visual angle; 67 is a 0.7 m wide 4K screen at 0.7 m.

    Raises:
        ShapeError: The pictures are not (H, W, 3) of one size.
        ParameterError: A picture has NaN or infinity, or ``pixels_per_degree`` is not above 0.

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
    reference_features, test_features = (_features((x[..., 0] + 16) / 116, pixels_per_degree) for x in (a, b))
    difference = np.maximum(*(np.abs(p - q) for p, q in zip(reference_features, test_features, strict=True)))
    feature = (difference / math.sqrt(2)) ** _FEATURE_POWER
    return np.asarray(np.clip(colour, 0, 1) ** (1 - np.clip(feature, 0, 1)), np.float32)

"""Fixed metrics: on pictures clipped to [0, 1] and encoded as sRGB, and one on unclipped light."""

import math

import numpy as np

from bokeh_bench.files import decode_srgb, encode_srgb

__all__ = ["METRICS", "edge_mask", "flip", "psnr", "scores", "ssim"]

METRICS = ("edge_psnr", "psnr", "ssim", "flip", "light")

_MIN_DEPTH_STEP = 0.05  # fraction of the larger depth


def psnr(squared: np.ndarray, peak: float = 1.0) -> float:
    """Return the PSNR of squared errors, dB, at most 100; NaN for an empty array."""
    if squared.size == 0:
        return math.nan
    return float(min(100.0, -10 * np.log10(max(float(squared.mean()) / peak**2, 1e-12))))


def edge_mask(depth: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return the mask of pixels that the blur of a depth step can reach, (H, W) bool.

    A step lies between two neighbours whose depths differ by more than 5 % of the larger; its reach is the
    larger of their blur radii, at least one pixel.

    Args:
        depth: True depth, metres, (H, W).
        radius: True blur radius, pixels, (H, W); the sign is ignored.
    """
    radius = np.maximum(np.abs(radius), 1)
    reach = np.zeros(depth.shape, int)
    ahead, behind = slice(None, -1), slice(1, None)
    for a, b in (((ahead,), (behind,)), ((slice(None), ahead), (slice(None), behind))):
        step = np.abs(depth[a] - depth[b]) > _MIN_DEPTH_STEP * np.maximum(depth[a], depth[b])
        far = np.where(step, np.ceil(np.maximum(radius[a], radius[b])), 0).astype(int)
        reach[a] = np.maximum(reach[a], far)
        reach[b] = np.maximum(reach[b], far)
    mask = np.zeros(depth.shape, bool)
    height, width = depth.shape
    for distance in np.unique(reach[reach > 0]):
        sources = np.pad(reach == distance, int(distance))
        y, x = np.mgrid[-distance : distance + 1, -distance : distance + 1]
        for dy, dx in zip(*(part[np.hypot(y, x) <= distance] + distance for part in (y, x)), strict=True):
            mask |= sources[dy : dy + height, dx : dx + width]
    return mask


def _smooth(values: np.ndarray, weights: np.ndarray, axis: int) -> np.ndarray:
    """Return the correlation of (H, W) with weights along an axis, border repeated."""
    half = len(weights) // 2
    padded = np.pad(values, [(half, half) if k == axis else (0, 0) for k in range(2)], mode="edge")
    size = values.shape[axis]
    return np.asarray(sum(w * np.take(padded, np.arange(k, k + size), axis) for k, w in enumerate(weights)))


def ssim(truth: np.ndarray, picture: np.ndarray) -> float:
    """Return the mean SSIM of two encoded pictures (H, W, 3), with a Gaussian window of 1.5 pixels.

    Source: Wang, Bovik, Sheikh and Simoncelli, "Image quality assessment: From error visibility to structural
    similarity", IEEE Transactions on Image Processing 2004.
    """
    weights = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
    weights /= weights.sum()

    def mean(values: np.ndarray) -> np.ndarray:
        return _smooth(_smooth(values, weights, 0), weights, 1)

    total = 0.0
    for a, b in zip(np.moveaxis(truth, -1, 0), np.moveaxis(picture, -1, 0), strict=True):
        mean_a, mean_b = mean(a), mean(b)
        var_a, var_b = mean(a * a) - mean_a**2, mean(b * b) - mean_b**2
        covariance = mean(a * b) - mean_a * mean_b
        similar = (2 * mean_a * mean_b + 1e-4) * (2 * covariance + 9e-4)
        similar /= (mean_a**2 + mean_b**2 + 1e-4) * (var_a + var_b + 9e-4)
        total += float(similar[5:-5, 5:-5].mean())
    return total / truth.shape[-1]


# Linear sRGB to XYZ, and FLIP's contrast sensitivities of Y, Cx and Cz: weights and widths, square degrees.
_TO_XYZ = np.array(
    [
        [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
        [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
        [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
    ]
)
_WHITE = _TO_XYZ.sum(1)
_SENSITIVITY = (((1.0, 0.0047),), ((1.0, 0.0053),), ((34.1, 0.04), (13.5, 0.025)))
_PIXELS_PER_DEGREE = 67.0


def _filtered(linear: np.ndarray) -> np.ndarray:
    """Return linear light filtered by the contrast sensitivity of the eye, clipped to [0, 1]."""
    x, y, z = np.moveaxis(linear @ _TO_XYZ.T / _WHITE, -1, 0)
    opponent = np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)
    half = math.ceil(3 * math.sqrt(0.04 / (2 * math.pi**2)) * _PIXELS_PER_DEGREE)
    position = np.arange(-half, half + 1) / _PIXELS_PER_DEGREE
    result = np.zeros_like(opponent)
    for channel, terms in enumerate(_SENSITIVITY):
        total = 0.0
        for weight, width in terms:
            gaussian = np.exp(-(math.pi**2) * position**2 / width)
            scale = weight * math.sqrt(math.pi / width)
            total += scale * gaussian.sum() ** 2
            result[..., channel] += scale * _smooth(_smooth(opponent[..., channel], gaussian, 0), gaussian, 1)
        result[..., channel] /= total
    y = (result[..., 0] + 16) / 116
    xyz = np.stack([result[..., 1] / 500 + y, y, y - result[..., 2] / 200], -1) * _WHITE
    return np.clip(xyz @ np.linalg.inv(_TO_XYZ).T, 0, 1)


def _hunt(linear: np.ndarray) -> np.ndarray:
    """Return L*a*b* with chroma scaled by lightness."""
    relative, delta = linear @ _TO_XYZ.T / _WHITE, 6 / 29
    root = np.where(relative > delta**3, np.cbrt(np.maximum(relative, 0)), relative / (3 * delta**2) + 4 / 29)
    lightness = 116 * root[..., 1] - 16
    a, b = 500 * (root[..., 0] - root[..., 1]), 200 * (root[..., 1] - root[..., 2])
    return np.stack([lightness, 0.01 * lightness * a, 0.01 * lightness * b], -1)


def _hyab(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    difference = a - b
    return np.asarray(np.abs(difference[..., 0]) + np.hypot(difference[..., 1], difference[..., 2]))


def _features(linear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the strengths of edges and points of the lightness."""
    lightness = (linear @ _TO_XYZ[1]) / _WHITE[1]
    deviation = 0.5 * 0.082 * _PIXELS_PER_DEGREE
    position = np.arange(-math.ceil(3 * deviation), math.ceil(3 * deviation) + 1)
    gaussian = np.exp(-(position**2) / (2 * deviation**2))
    results = []
    for shape in (-position * gaussian, (position**2 / deviation**2 - 1) * gaussian):
        above, below = shape[shape > 0].sum() * gaussian.sum(), -shape[shape < 0].sum() * gaussian.sum()
        balanced = np.where(shape > 0, shape / above, shape / below)
        across = _smooth(_smooth(lightness, balanced, 1), gaussian, 0)
        down = _smooth(_smooth(lightness, balanced, 0), gaussian, 1)
        results.append(np.hypot(across, down))
    return results[0], results[1]


def flip(truth: np.ndarray, picture: np.ndarray) -> float:
    """Return the mean FLIP error of two encoded pictures at 67 pixels per degree, 0 to 1; 0 is best.

    Source: Andersson et al., "FLIP: A difference evaluator for alternating images", 2020.
    """
    linear = [decode_srgb(np.clip(each, 0, 1)) for each in (truth, picture)]
    error = _hyab(*(_hunt(_filtered(each)) for each in linear)) ** 0.7
    green, blue = (_hunt(np.array(color)) for color in ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]))
    largest = float(_hyab(green, blue)) ** 0.7
    knee = 0.4 * largest
    color = np.where(error < knee, 0.95 / knee * error, 0.95 + (error - knee) / (largest - knee) * 0.05)
    pairs = zip(*(_features(each) for each in linear), strict=True)
    feature = np.maximum(*(np.abs(a - b) for a, b in pairs))
    feature = np.clip((feature / math.sqrt(2)) ** 0.5, 0, 1)
    return float((np.clip(color, 0, 1) ** (1 - feature)).mean())


def scores(truth: np.ndarray, picture: np.ndarray, mask: np.ndarray) -> dict[str, float]:
    """Return all metrics of a picture.

    Args:
        truth: Scene-linear, unclipped, (H, W, 3).
        picture: Scene-linear, of the same size.
        mask: Pixels that a depth step reaches, see :func:`edge_mask`.

    Returns:
        ``edge_psnr`` and ``psnr``, dB; ``ssim``; ``flip``; ``light``: PSNR of log(1 + light) without
        clipping, dB, with the truth's maximum as peak, which sees lamps.
    """
    encoded, expected = encode_srgb(picture), encode_srgb(truth)
    squared = (encoded - expected) ** 2
    log_truth, log_picture = (np.log1p(np.maximum(each, 0).astype(np.float64)) for each in (truth, picture))
    return {
        "edge_psnr": psnr(squared[mask]),
        "psnr": psnr(squared),
        "ssim": ssim(expected, encoded),
        "flip": flip(expected, encoded),
        "light": psnr((log_picture - log_truth) ** 2, max(float(log_truth.max()), 1e-6)),
    }

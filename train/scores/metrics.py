"""Quality metrics of a render against the truth, on clipped, sRGB-encoded pictures unless stated otherwise.

:func:`compare` returns the few scores that training monitors, :class:`Scorer` all scores for many renders of
one picture.
"""

import math
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt
from skimage.metrics import structural_similarity

from bokehnet.classical.error_map import geometric_error_map
from bokehnet.io.color.srgb import linear_to_srgb

__all__ = [
    "BANDS",
    "Scorer",
    "band_label",
    "compare",
    "depth_step_pixels",
    "edge_pixels",
    "encode",
    "mean_scores",
    "psnr",
    "similarity",
]

# Ranges of the true blur radius, pixels.
BANDS = ((0.0, 10.0), (10.0, 20.0), (20.0, 40.0), (40.0, math.inf))

_MIN_DEPTH_STEP = 0.05  # fraction of the larger depth
_MIN_PIXELS = 100  # a score of fewer pixels is not representative
_MS_SSIM_MIN_SIDE_PX = 160  # MS-SSIM halves the picture four times and then needs eleven pixels


def edge_pixels(defocus: np.ndarray) -> np.ndarray:
    """Return the mask of pixels within the blur radius of a depth discontinuity, (H, W) bool."""
    return np.asarray(geometric_error_map(defocus, softness=0) > 0.5)


def encode(linear: np.ndarray) -> np.ndarray:
    """Return scene-linear light clipped and encoded as sRGB in [0, 1], float64."""
    return np.asarray(linear_to_srgb(np.clip(linear, 0, 1)), np.float64)


def psnr(squared: np.ndarray, peak: float = 1.0) -> float:
    """Return the PSNR of squared errors, dB, at most 100; NaN for an empty array."""
    if squared.size == 0:
        return float("nan")
    return float(min(100.0, -10 * np.log10(max(float(squared.mean()) / peak**2, 1e-12))))


def similarity(truth: np.ndarray, render: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the SSIM of two encoded pictures (H, W, 3), and its map (H, W, 3).

    Source:
        Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: From error visibility to structural
        similarity", IEEE Transactions on Image Processing 2004.
    """
    ssim, ssim_map = structural_similarity(
        truth,
        render,
        channel_axis=2,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    return float(ssim), ssim_map


def compare(render: np.ndarray, truth: np.ndarray, defocus: np.ndarray) -> dict[str, float]:
    """Return the scores of one picture.

    Args:
        render: Scene-linear, (H, W, 3).
        truth: Scene-linear, (H, W, 3).
        defocus: True defocus, pixels, (H, W); determines the edge pixels.

    Returns:
        ``psnr`` and ``ssim`` over all pixels; ``edge_psnr`` and ``edge_ssim`` over edge pixels, NaN without
        any; dB and [0, 1].
    """
    encoded, encoded_truth = encode(render), encode(truth)
    squared = (encoded - encoded_truth) ** 2
    ssim, ssim_map = similarity(encoded_truth, encoded)
    near = edge_pixels(defocus)
    return {
        "psnr": psnr(squared),
        "ssim": ssim,
        "edge_psnr": psnr(squared[near]),
        "edge_ssim": float(ssim_map[near].mean()) if near.any() else float("nan"),
    }


def mean_scores(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Return the mean of each score over all rows, NaN excluded."""
    return {key: float(np.nanmean([row[key] for row in rows])) for key in rows[0]}


def band_label(band: tuple[float, float]) -> str:
    """Return the label of a band, such as ``0-10`` or ``>40``."""
    return f"{band[0]:g}-{band[1]:g}" if math.isfinite(band[1]) else f">{band[0]:g}"


def depth_step_pixels(disparity: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    """Return the mask of pixels in reach of a depth step, a stricter definition than :func:`edge_pixels`.

    A step lies between two neighbours whose depths differ by more than 5 % of the larger, even if both have
    the same blur radius; its reach is the larger of their blur radii, at least one pixel.

    Args:
        disparity: True inverse depth, (H, W), any unit; 0 is infinitely far.
        defocus: True defocus in pixels, (H, W).

    Returns:
        Mask (H, W) bool.
    """
    radius = np.maximum(np.abs(defocus), 1)
    reach = np.zeros(disparity.shape)
    ahead, behind = slice(None, -1), slice(1, None)
    for a, b in (((ahead,), (behind,)), ((slice(None), ahead), (slice(None), behind))):
        # |1/p - 1/q| > s max(1/p, 1/q) is |p - q| > s max(p, q), which also holds for the sky.
        p, q = disparity[a], disparity[b]
        step = np.abs(p - q) > _MIN_DEPTH_STEP * np.maximum(p, q)
        far = np.where(step, np.ceil(np.maximum(radius[a], radius[b])), 0)
        reach[a] = np.maximum(reach[a], far)
        reach[b] = np.maximum(reach[b], far)
    mask = np.zeros(disparity.shape, bool)
    for distance in np.unique(reach[reach > 0]):
        mask |= distance_transform_edt(reach != distance) <= distance
    return mask


def _multiscale_similarity(truth: np.ndarray, render: np.ndarray) -> float:
    """Return the MS-SSIM of two encoded pictures; NaN if they are too small.

    Source:
        Wang, Simoncelli, Bovik, "Multi-scale structural similarity for image quality assessment",
        Asilomar Conference on Signals, Systems and Computers 2003.
    """
    if min(truth.shape[:2]) <= _MS_SSIM_MIN_SIDE_PX:
        return math.nan
    import torch
    from pytorch_msssim import ms_ssim

    pair = (torch.from_numpy(x.transpose(2, 0, 1).astype(np.float32))[None] for x in (render, truth))
    return float(ms_ssim(*pair, data_range=1.0))


def _flip_map(truth: np.ndarray, render: np.ndarray) -> np.ndarray:
    """Return the FLIP map of two encoded pictures, (H, W) in [0, 1], at 67 pixels per degree.

    Source:
        Andersson et al., "FLIP: A difference evaluator for alternating images", Proceedings of the ACM on
        Computer Graphics and Interactive Techniques 2020.
    """
    from flip_evaluator import evaluate

    pair = (picture.astype(np.float32) for picture in (truth, render))
    return np.asarray(evaluate(*pair, "LDR", applyMagma=False)[0])[..., 0]


class Scorer:
    """Scorer for many renders of one picture.

    Args:
        truth: True picture, scene-linear, (H, W, 3).
        defocus: True defocus, pixels, (H, W).
        disparity: True inverse depth, (H, W), any unit; 0 is infinitely far. ``step_psnr`` is NaN without it.
    """

    def __init__(self, truth: np.ndarray, defocus: np.ndarray, disparity: np.ndarray | None = None) -> None:
        self._truth = encode(truth)
        self._log_truth = np.log1p(np.maximum(truth, 0).astype(np.float64))
        self._log_peak = max(float(self._log_truth.max()), 1e-6)
        self._near = edge_pixels(defocus)
        empty = np.zeros(defocus.shape, bool)
        self._step = empty if disparity is None else depth_step_pixels(disparity, defocus)
        radius = np.abs(defocus)
        self._bands = {band_label(band): (band[0] <= radius) & (radius < band[1]) for band in BANDS}

    def __call__(self, render: np.ndarray, classical: np.ndarray | None = None) -> dict[str, float]:
        """Return the scores of one render.

        Args:
            render: Scene-linear, (H, W, 3).
            classical: The classical half of a hybrid, scene-linear, (H, W, 3).

        Returns:
            In dB, NaN over fewer than 100 pixels: ``psnr``; ``edge_psnr`` over
            :func:`edge_pixels`; ``step_psnr`` over :func:`depth_step_pixels`; ``flat_psnr`` over all other
            pixels; ``flat_psnr_gain``, its gain over that of ``classical``; ``flat_psnr_like``, its value
            with ``classical`` as the truth; ``psnr_B`` and ``edge_psnr_B`` over pixels of each of ``BANDS``,
            with label B; ``log_psnr`` of log(1 + x) of unclipped light, with the peak of the truth.
            In [0, 1]: ``ssim`` and ``edge_ssim``; ``ms_ssim``; ``flip`` and ``edge_flip``, 0 is best.
        """
        encoded = encode(render)
        squared = ((encoded - self._truth) ** 2).mean(axis=2)
        ssim, ssim_map = similarity(self._truth, encoded)
        flip_map = _flip_map(self._truth, encoded)
        log_squared = (np.log1p(np.maximum(render, 0).astype(np.float64)) - self._log_truth) ** 2
        near = self._near
        scores = {
            "psnr": psnr(squared),
            "ssim": ssim,
            "ms_ssim": _multiscale_similarity(self._truth, encoded),
            "flip": float(flip_map.mean()),
            "log_psnr": psnr(log_squared, self._log_peak),
            "edge_psnr": _masked_psnr(squared, near),
            "edge_ssim": float(ssim_map[near].mean()) if near.any() else math.nan,
            "edge_flip": float(flip_map[near].mean()) if near.any() else math.nan,
            "step_psnr": _masked_psnr(squared, self._step),
            "flat_psnr": _masked_psnr(squared, ~near),
            "flat_psnr_gain": math.nan,
            "flat_psnr_like": math.nan,
        }
        if classical is not None:
            base = encode(classical)
            of_classical = _masked_psnr(((base - self._truth) ** 2).mean(axis=2), ~near)
            scores["flat_psnr_gain"] = scores["flat_psnr"] - of_classical
            scores["flat_psnr_like"] = _masked_psnr(((encoded - base) ** 2).mean(axis=2), ~near)
        for label, band in self._bands.items():
            scores[f"psnr_{label}"] = _masked_psnr(squared, band)
            scores[f"edge_psnr_{label}"] = _masked_psnr(squared, band & near)
        return scores


def _masked_psnr(squared: np.ndarray, mask: np.ndarray) -> float:
    return psnr(squared[mask]) if np.count_nonzero(mask) >= _MIN_PIXELS else math.nan

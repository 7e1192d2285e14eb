"""How close a render is to the truth: PSNR and SSIM on the clipped, sRGB-encoded picture."""

from typing import Any

import numpy as np
from skimage.metrics import structural_similarity

from bokehnet.classical.error_map import geometric_error_map
from bokehnet.io.color import linear_to_srgb

__all__ = ["compare", "edge_pixels", "encode", "mean_scores", "psnr", "similarity"]


def edge_pixels(defocus: np.ndarray) -> np.ndarray:
    """Pixels within the blur radius of a depth discontinuity, (H, W) bool."""
    return np.asarray(geometric_error_map(defocus, softness=0) > 0.5)


def encode(linear: np.ndarray) -> np.ndarray:
    """Scene-linear light as it is shown, sRGB in [0, 1], float64."""
    return np.asarray(linear_to_srgb(np.clip(linear, 0, 1)), np.float64)


def psnr(squared: np.ndarray, peak: float = 1.0) -> float:
    """PSNR of squared errors, dB, at most 100; NaN where there are none."""
    if squared.size == 0:
        return float("nan")
    return float(min(100.0, -10 * np.log10(max(float(squared.mean()) / peak**2, 1e-12))))


def similarity(wanted: np.ndarray, got: np.ndarray) -> tuple[float, np.ndarray]:
    """SSIM of two encoded pictures (H, W, 3), and its map (H, W, 3).

    Source:
        Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: From error visibility to structural
        similarity", IEEE Transactions on Image Processing 2004.
    """
    ssim, ssim_map = structural_similarity(
        wanted,
        got,
        channel_axis=2,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    return float(ssim), ssim_map


def compare(render: np.ndarray, truth: np.ndarray, defocus: np.ndarray) -> dict[str, float]:
    """Scores of one picture.

    Args:
        render: Scene-linear, (H, W, 3).
        truth: Scene-linear, (H, W, 3).
        defocus: True defocus in pixels, (H, W); tells which pixels lie near an edge in depth.

    Returns:
        ``psnr`` and ``ssim`` over all pixels; ``edge_psnr`` and ``edge_ssim`` over edge pixels, NaN where
        there are none; dB and [0, 1].
    """
    got, wanted = encode(render), encode(truth)
    squared = (got - wanted) ** 2
    ssim, ssim_map = similarity(wanted, got)
    near = edge_pixels(defocus)
    return {
        "psnr": psnr(squared),
        "ssim": ssim,
        "edge_psnr": psnr(squared[near]),
        "edge_ssim": float(ssim_map[near].mean()) if near.any() else float("nan"),
    }


def mean_scores(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Mean of each score over all rows that have it."""
    return {key: float(np.nanmean([row[key] for row in rows])) for key in rows[0]}

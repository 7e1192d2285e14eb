"""How close a render is to the truth: PSNR and SSIM on the clipped, sRGB-encoded picture."""

from typing import Any

import numpy as np
from skimage.metrics import structural_similarity

from bokehnet.classical.error_map import geometric_error_map
from bokehnet.io.color import linear_to_srgb

__all__ = ["compare", "edge_pixels", "mean_scores"]


def edge_pixels(defocus: np.ndarray) -> np.ndarray:
    """Pixels within the blur radius of a depth discontinuity, (H, W) bool."""
    return np.asarray(geometric_error_map(defocus, softness=0) > 0.5)


def _psnr(squared: np.ndarray) -> float:
    return float(min(100.0, -10 * np.log10(max(float(squared.mean()), 1e-12))))


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
    got, wanted = (linear_to_srgb(np.clip(x, 0, 1)).astype(np.float64) for x in (render, truth))
    squared = (got - wanted) ** 2
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
    near = edge_pixels(defocus)
    some = bool(near.any())
    return {
        "psnr": _psnr(squared),
        "ssim": float(ssim),
        "edge_psnr": _psnr(squared[near]) if some else float("nan"),
        "edge_ssim": float(ssim_map[near].mean()) if some else float("nan"),
    }


def mean_scores(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Mean of each score over all rows that have it."""
    return {key: float(np.nanmean([row[key] for row in rows])) for key in rows[0]}

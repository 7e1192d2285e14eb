"""Pictures and maps for the tests of the depth repair."""

import numpy as np
from scipy.ndimage import gaussian_filter


def blobs(height: int = 200, width: int = 320) -> np.ndarray:
    """Return a map of near discs in front of a far slope, at least 14 pixels apart, (H, W)."""
    y, x = np.mgrid[:height, :width]
    disparity = (0.1 + 1e-4 * x).astype(np.float32)
    for row in range(40, height, 64):
        for column in range(40, width, 64):
            disparity[np.hypot(y - row, x - column) < 24] = 0.8
    return disparity


def textured(truth: np.ndarray) -> np.ndarray:
    """Return a textured picture with different colours near and far, scene-linear (H, W, 3)."""
    rng = np.random.default_rng(1)
    near = np.where(truth[..., None] > 0.5, (0.6, 0.3, 0.1), (0.1, 0.3, 0.5))
    return (near * rng.uniform(0.8, 1.2, truth.shape)[..., None]).astype(np.float32)


def texture(seed: int, shape: tuple[int, ...] = (3, 200, 320)) -> np.ndarray:
    """Return texture without edges, scene-linear (3, H, W)."""
    values = gaussian_filter(np.random.default_rng(seed).standard_normal(shape), (0, 1, 1))
    return (0.3 * np.exp(0.4 * values / values.std())).astype(np.float32)

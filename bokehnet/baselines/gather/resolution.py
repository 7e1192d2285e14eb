"""Resolution multiplier of the gathers: render at another resolution than that of the picture.

Source: thesis 004, 3.1, whose example multiplies the resolution of all textures, and 2.4.1, which names a
lower resolution as the way to fewer samples.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np

from bokehnet.checks import check_range
from bokehnet.optics.aperture import Aperture

__all__ = ["resized", "with_resolution"]

# Range of the multiplier.
_MIN_RESOLUTION, _MAX_RESOLUTION = 0.1, 4.0


def _weights(old: int, new: int) -> np.ndarray:
    """Return the weights (new, old) of a resize: means over the pixels' areas, or linear if it enlarges."""
    edges = np.arange(new + 1) * old / new
    index = np.arange(old)
    if new <= old:
        low, high = np.maximum(edges[:-1, None], index), np.minimum(edges[1:, None], index + 1)
        weights = np.maximum(high - low, 0)
    else:
        middle = np.clip((np.arange(new) + 0.5) * old / new - 0.5, 0, old - 1)
        weights = np.maximum(1 - np.abs(middle[:, None] - index), 0)
    return np.asarray(weights / weights.sum(1, keepdims=True))


def resized(image: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return a picture (H, W, C) at another size, float32: means of areas, or linear where it enlarges."""
    rows, columns = (_weights(old, new) for old, new in zip(image.shape[:2], shape, strict=True))
    result = np.einsum(
        "ij,jkc->ikc", rows, np.einsum("kl,jlc->jkc", columns, image, optimize=True), optimize=True
    )
    return np.asarray(result, np.float32)


def with_resolution(method: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """Return the method with a parameter ``resolution``, the multiplier of the picture's size, 0.1 to 4.

    Below 1 the time falls with its square and pixels in focus are as soft as the smaller picture; above 1
    edges of the map are finer. The defocus of the nearest pixel is multiplied likewise.
    """

    @wraps(method)
    def render(
        image: np.ndarray,
        defocus: np.ndarray,
        aperture: Aperture | None = None,
        *,
        resolution: float = 1.0,
        **options: Any,
    ) -> np.ndarray:
        check_range("resolution", resolution, _MIN_RESOLUTION, _MAX_RESOLUTION)
        if resolution == 1:
            return method(image, defocus, aperture, **options)
        height, width = defocus.shape
        size = max(1, round(height * resolution)), max(1, round(width * resolution))
        rows, columns = (
            np.minimum(((np.arange(new) + 0.5) * old / new).astype(int), old - 1)
            for new, old in zip(size, (height, width), strict=True)
        )
        small = np.ascontiguousarray(defocus[np.ix_(rows, columns)] * np.float32(resolution))
        return resized(method(resized(image, size), small, aperture, **options), (height, width))

    return render

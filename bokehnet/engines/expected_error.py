"""Expected error of the rays, pixel by pixel: ErrorNet on a small copy of the picture."""

from functools import lru_cache

import numpy as np

from bokehnet.arrays.pyramid import count_halvings, upsample2
from bokehnet.classical.base import ClassicalResult
from bokehnet.engines.small_copy import SmallCopy
from bokehnet.errors import ParameterError
from bokehnet.inference.session import WEIGHTS, OnnxNetwork, load_network
from bokehnet.optics.aberrations.lens_response import LensResponse

__all__ = ["ERROR_BYTES", "LARGEST_BLUR", "ErrorEstimate", "check_expected_error", "supports_expected_error"]

# Memory per pixel that the network sees, bytes.
ERROR_BYTES = 300

# Largest blur radius in its training, pixels: if the blur is larger, it sees the picture halved.
LARGEST_BLUR = 26.0

# Rows of the small copy that are enlarged at a time, and rows around them on which these depend.
_ROWS, _MARGIN = 64, 2


def supports_expected_error(classical: str, lens_response: LensResponse, gamma: float) -> bool:
    """Return whether the error of such pictures is learned: rays, a perfect lens and no gamma.

    Args:
        classical: Name of the classical renderer.
        lens_response: Response of the lens.
        gamma: Gamma of the highlights.
    """
    return classical == "rays" and gamma == 1 and lens_response.is_ideal


def check_expected_error(classical: str, lens_response: LensResponse, gamma: float, name: str) -> None:
    """Raise ``ParameterError`` unless :func:`supports_expected_error`; ``name`` is that of the engine."""
    if supports_expected_error(classical, lens_response, gamma):
        return
    if classical != "rays":
        raise ParameterError("expected_error", "an engine with rays: rays or hybrid", shown=f"`{name}`")
    expected = "a perfect lens and a gamma of 1, as in the training of the error network"
    raise ParameterError("expected_error", expected, shown="another lens or gamma")


@lru_cache(maxsize=1)
def _network(threads: int) -> OnnxNetwork:
    return load_network(WEIGHTS / "error", "error", ("image", "rays", "scatter", "features"), threads)


class ErrorEstimate:
    """Collects the rays' render of a picture, rows after rows, and returns its expected error.

    Args:
        height: Height of the picture, pixels.
        width: Width of the picture, pixels.
        max_coc_radius: Largest blur radius of the picture, pixels.
        max_pixels: Maximum number of pixels that the network sees; the picture is halved until it has no
            more.
        threads: Threads of the network; 0 uses all cores.
    """

    def __init__(
        self, height: int, width: int, max_coc_radius: float, max_pixels: int, threads: int = 0
    ) -> None:
        self._size, self._network = (height, width), _network(threads)
        self._small = SmallCopy(height, width, count_halvings(max_coc_radius, LARGEST_BLUR), max_pixels)

    def add(self, first: int, image: np.ndarray, defocus: np.ndarray, classical: ClassicalResult) -> None:
        """Add rows of the picture.

        Args:
            first: Row of the picture at which the arrays begin; a multiple of 128, or 0.
            image: Scene-linear picture, (H, W, 3).
            defocus: Signed blur radius in pixels, (H, W).
            classical: Rays' render of these rows.
        """
        assert classical.scatter is not None
        assert classical.disocclusion_weight is not None
        arrays = {"image": image, "rays": classical.bokeh, "scatter": classical.scatter}
        maps = {
            "defocus": defocus,
            "disocclusion_weight": classical.disocclusion_weight,
            "error_map": classical.error_map,
        }
        self._small.add(first, arrays | {name: array[..., None] for name, array in maps.items()})

    def estimate(self) -> np.ndarray:
        """Return (H, W) float32: expected mean over colors of |sRGB value - truth|, 8-bit levels.

        If the network saw a small copy, it is the error of means over blocks of pixels.
        """
        batch, names = self._small.batch(), ("defocus", "disocclusion_weight", "error_map")
        features = np.concatenate([batch[name] for name in names], axis=1)
        errors = self._network(batch["image"], batch["rays"], batch["scatter"], features, release=True)
        return _enlarged(errors[0, 0], self._small.halvings, *self._size)


def _enlarged(small: np.ndarray, halvings: int, height: int, width: int) -> np.ndarray:
    """Return bilinear doublings of (h, w), cropped to a size, some rows at a time to bound the memory."""
    result, factor = np.empty((height, width), np.float32), 2**halvings
    for first in range(0, len(small), _ROWS):
        above = min(first, _MARGIN)
        rows = small[first - above : first + _ROWS + _MARGIN]
        for _ in range(halvings):
            rows = upsample2(rows)
        block = result[first * factor : (first + _ROWS) * factor]
        block[:] = rows[above * factor :][: len(block), :width]
    return result

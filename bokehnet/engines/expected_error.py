"""How far off a picture of the rays may be, pixel by pixel: ErrorNet on a small copy of it."""

from functools import lru_cache

import numpy as np

from bokehnet.arrays.pyramid import count_halvings, upsample2
from bokehnet.classical.base import ClassicalResult
from bokehnet.engines.small_copy import SmallCopy
from bokehnet.errors import ParameterError
from bokehnet.inference.session import WEIGHTS, OnnxNetwork, load_network
from bokehnet.optics.aberrations.lens_response import LensResponse

__all__ = ["ERROR_BYTES", "LARGEST_BLUR", "ErrorEstimate", "can_expect_error", "check_expects_error"]

# Bytes that the network takes for a pixel that it sees.
ERROR_BYTES = 300

# Largest blur radius that it learned from, pixels: where blur is larger, it sees the picture halved.
LARGEST_BLUR = 26.0

# Rows of the small copy that are enlarged at a time, and those around them on which these depend.
_ROWS, _AROUND = 64, 2


def can_expect_error(classical: str, lens_response: LensResponse, gamma: float) -> bool:
    """Whether errors were learned of such pictures: by rays, and behind nothing that changes them.

    Args:
        classical: Name of the classical renderer.
        lens_response: Of the lens.
        gamma: Of the highlights.
    """
    return classical == "rays" and gamma == 1 and lens_response.is_ideal


def check_expects_error(classical: str, lens_response: LensResponse, gamma: float, name: str) -> None:
    """Raise ``ParameterError`` unless :func:`can_expect_error`; ``name`` is that of the engine."""
    if can_expect_error(classical, lens_response, gamma):
        return
    if classical != "rays":
        raise ParameterError("expected_error", "an engine with rays: rays or hybrid", shown=f"`{name}`")
    expected = "a plain lens and a gamma of 1, of which alone errors were learned"
    raise ParameterError("expected_error", expected, shown="others")


@lru_cache(maxsize=1)
def _network(threads: int) -> OnnxNetwork:
    return load_network(WEIGHTS / "error", "error", ("image", "rays", "scatter", "features"), threads)


class ErrorEstimate:
    """Gathers what the rays made of a picture, rows after rows, and tells what error is to be expected.

    Args:
        height: Of the picture.
        width: Of the picture.
        largest: Its largest blur radius, pixels.
        most_pixels: Of what the network sees; the picture is halved until it has no more.
        threads: Threads of the network; 0 takes all cores.
    """

    def __init__(self, height: int, width: int, largest: float, most_pixels: int, threads: int = 0) -> None:
        self._size, self._network = (height, width), _network(threads)
        self._small = SmallCopy(height, width, count_halvings(largest, LARGEST_BLUR), most_pixels)

    def add(self, first: int, image: np.ndarray, defocus: np.ndarray, classical: ClassicalResult) -> None:
        """Take in rows of the picture.

        Args:
            first: Row of the picture at which the arrays begin; a multiple of 128, or 0.
            image: Scene-linear, (H, W, 3).
            defocus: Signed radius in pixels, (H, W).
            classical: What the rays made of these rows.
        """
        assert classical.scatter is not None
        assert classical.disocclusion_weight is not None
        parts = {"image": image, "rays": classical.bokeh, "scatter": classical.scatter}
        maps = {
            "defocus": defocus,
            "disocclusion_weight": classical.disocclusion_weight,
            "error_map": classical.error_map,
        }
        self._small.add(first, parts | {name: array[..., None] for name, array in maps.items()})

    def tell(self) -> np.ndarray:
        """Return (H, W) float32: expected mean over colours of |sRGB value - truth|, 8-bit levels.

        Where the network saw a small copy, it is the error of means over blocks of pixels.
        """
        batch, names = self._small.batch(), ("defocus", "disocclusion_weight", "error_map")
        features = np.concatenate([batch[name] for name in names], axis=1)
        told = self._network(batch["image"], batch["rays"], batch["scatter"], features, release=True)
        return _enlarged(told[0, 0], self._small.halvings, *self._size)


def _enlarged(small: np.ndarray, halvings: int, height: int, width: int) -> np.ndarray:
    """Bilinear doublings of (h, w), cut to a size, some rows at a time, as each is a few copies of them."""
    result, factor = np.empty((height, width), np.float32), 2**halvings
    for first in range(0, len(small), _ROWS):
        above = min(first, _AROUND)
        rows = small[first - above : first + _ROWS + _AROUND]
        for _ in range(halvings):
            rows = upsample2(rows)
        place = result[first * factor : (first + _ROWS) * factor]
        place[:] = rows[above * factor :][: len(place), :width]
    return result

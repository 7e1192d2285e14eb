"""Tilted focus by slices: a tilted sensor interpolates in pictures of untilted sensors.

The light behind a lens fills a volume. Untilted sensors at several distances sample it in slices, each a
picture with its own focus; a tilted sensor cuts through all of them. From the pupil all slices show the same
directions, so a pixel of the tilted sensor interpolates its own position in the slices of the two nearest
foci. Discs become decentred ellipses, as they should, although those of each slice are round.

Faults: those of the renderer of the slices; between two slices edges are a mixture; no foreshortening of the
    aperture from a tilted sensor (1 % at 8 degrees); light falloff is that of the input picture.

Source: thesis 001, 3.3.2, "Spreading for tilt-shift configurations".
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_above, check_same_size, check_whole
from bokehnet.classical.scatter_renderer import scatter_inside
from bokehnet.errors import ParameterError
from bokehnet.optics.focus_plane import FocusPlane

__all__ = ["ImageSpace", "image_space"]

Blur = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ImageSpace:
    """Pictures of untilted sensors.

    Attributes:
        focus: Disparity in focus of each slice, rising, (N,).
        slices: Scene-linear slices, (N, H, W, 3).
    """

    focus: np.ndarray
    slices: np.ndarray

    def view(self, plane: FocusPlane) -> np.ndarray:
        """Return the picture of a sensor on which this plane is in focus, (H, W, 3).

        Raises:
            ParameterError: The plane exceeds the range of the slices.
        """
        height, width = self.slices.shape[1:3]
        y, x = np.mgrid[:height, :width]
        focus = np.broadcast_to(plane.at(x, y), (height, width))
        low, high = float(focus.min()), float(focus.max())
        if low < self.focus[0] or high > self.focus[-1]:
            expected = f"a focus within that of the slices, {self.focus[0]:g} to {self.focus[-1]:g}"
            raise ParameterError("plane", expected, shown=f"{low:g} to {high:g}")
        index = np.clip(np.searchsorted(self.focus, focus, side="right") - 1, 0, len(self.focus) - 2)
        fraction = (focus - self.focus[index]) / (self.focus[index + 1] - self.focus[index])
        lower, upper = self.slices[index, y, x], self.slices[index + 1, y, x]
        return np.asarray(lower + fraction[..., None] * (upper - lower), np.float32)


def image_space(
    image: np.ndarray,
    disparity: np.ndarray,
    blur: float,
    foci: tuple[float, float],
    *,
    count: int = 16,
    render: Blur = scatter_inside,
) -> ImageSpace:
    """Render the slices.

    Args:
        image: All-in-focus picture of the tilted sensor, scene-linear, (H, W, 3).
        disparity: Disparity, (H, W).
        blur: Blur radius per unit of disparity, pixels.
        foci: Minimum and maximum disparity in focus.
        count: Number of evenly spaced slices, at least 2. Their distance times ``blur`` is the step of the
            radius from slice to slice; a pixel or less suffices.
        render: Function that blurs a picture by its defocus in pixels.

    Raises:
        ShapeError: The sizes differ.
        ParameterError: A number is out of range, or the foci do not rise.
    """
    check_same_size("image", image, "disparity", disparity)
    check_above("blur", blur, 0)
    check_whole("count", count, 2)
    if not foci[0] < foci[1]:
        raise ParameterError("foci", "the minimum, then the maximum", foci)
    focus = np.linspace(*foci, count)
    slices = [render(image, (blur * (disparity - at)).astype(np.float32)) for at in focus]
    return ImageSpace(focus=focus, slices=np.stack(slices))

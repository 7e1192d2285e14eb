"""Tilt by slices: pictures of untilted sensors, of which a sensor that leans takes what each place needs.

Behind a lens the light of a scene fills a volume. Sensors that stand upright at many distances cut it in
slices, each a picture of its own focus; a sensor that leans sees a slice of all of them. Seen from the pupil,
slices show the same directions, so that a pixel of the leaning sensor takes its own place in those of the two
nearest foci. Discs are cut as they should be, to ellipses off their middle, though each slice's are round.

Faults: those of what renders the slices; between two slices edges are a mixture; the opening does not look
narrower from a sensor that leans (1 % at 8 degrees); light falls off as in the picture that was given.

Source: thesis 001, 3.3.2, "Spreading for tilt-shift configurations".
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_above, check_same_size, check_whole
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.errors import ParameterError
from bokehnet.optics.focus_plane import FocusPlane

__all__ = ["ImageSpace", "image_space"]

Blur = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ImageSpace:
    """Pictures of upright sensors.

    Attributes:
        focus: Disparity in focus of each, rising, (N,).
        slices: (N, H, W, 3), scene-linear.
    """

    focus: np.ndarray
    slices: np.ndarray

    def view(self, plane: FocusPlane) -> np.ndarray:
        """What a sensor sees on which this plane is in focus, (H, W, 3).

        Raises:
            ParameterError: It reaches beyond the slices.
        """
        height, width = self.slices.shape[1:3]
        y, x = np.mgrid[:height, :width]
        wanted = np.broadcast_to(plane.at(x, y), (height, width))
        low, high = float(wanted.min()), float(wanted.max())
        if low < self.focus[0] or high > self.focus[-1]:
            expected = f"a focus within that of the slices, {self.focus[0]:g} to {self.focus[-1]:g}"
            raise ParameterError("plane", expected, shown=f"{low:g} to {high:g}")
        at = np.clip(np.searchsorted(self.focus, wanted, side="right") - 1, 0, len(self.focus) - 2)
        share = (wanted - self.focus[at]) / (self.focus[at + 1] - self.focus[at])
        one, other = self.slices[at, y, x], self.slices[at + 1, y, x]
        return np.asarray(one + share[..., None] * (other - one), np.float32)


def image_space(
    image: np.ndarray,
    disparity: np.ndarray,
    blur: float,
    foci: tuple[float, float],
    *,
    count: int = 16,
    render: Blur = scatter,
) -> ImageSpace:
    """Render the slices.

    Args:
        image: Scene-linear, (H, W, 3), as the leaning sensor sees it all in focus.
        disparity: (H, W).
        blur: Radius in pixels of what is one unit of disparity out of focus.
        foci: Least and largest disparity that is to be in focus anywhere.
        count: Slices, evenly spread over that, from 2 up. Their distance times ``blur`` is the step of the
            radius from slice to slice; a pixel or less is enough.
        render: Blurs a picture by its defocus in pixels.

    Raises:
        ShapeError: Sizes that differ.
        ParameterError: A wrong number, or foci that do not rise.
    """
    check_same_size("image", image, "disparity", disparity)
    check_above("blur", blur, 0)
    check_whole("count", count, 2)
    if not foci[0] < foci[1]:
        raise ParameterError("foci", "the least, then the largest", foci)
    focus = np.linspace(*foci, count)
    slices = [render(image, (blur * (disparity - at)).astype(np.float32)) for at in focus]
    return ImageSpace(focus=focus, slices=np.stack(slices))

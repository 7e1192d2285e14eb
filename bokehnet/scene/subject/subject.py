"""Subject of a picture: the surface to focus on, from depth, sharpness, colour and faces.

The map is cut into bands of disparity; the connected surfaces of each band are candidates. A candidate scores
by its place (near the centre or the thirds), size, nearness, outline (it stands in front of what is around
it), sharpness and colour contrast. Ground that runs out of the lower border is no candidate. A score that is
too low gives no subject; the focus then falls back to the centre-weighted near part of the picture.

The subject has a range of disparities, not one: estimated maps let the sides of a round body recede, and a
single plane would blur its outline.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.square_windows import eroded
from bokehnet.checks import check_map
from bokehnet.io.window import Window
from bokehnet.scene.subject.candidates import (
    certainty_of,
    fallback,
    filled_fraction,
    score,
    surfaces_of_bands,
)
from bokehnet.scene.subject.faces import FaceDetector
from bokehnet.scene.subject.view import SubjectSearch, View, display, grown

__all__ = ["Subject", "find_subject", "surface_around"]

Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

# Number of the best candidates that are checked for holes.
_MAX_FILLED = 12

# Maximum area of a grown surface, in areas of its candidate.
_MAX_GROWTH = 2.5


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Subject:
    """Subject of a picture.

    Attributes:
        position: Pixel on the subject near its middle, (column, row) in the map.
        mask: Visible surface of the subject, (H, W), at the size of the analysis (coarse).
        disparity: Median disparity of the surface, in the unit of the map: the focus.
        near: Largest disparity that is to be sharp.
        far: Smallest disparity that is to be sharp.
        certainty: Certainty of the choice, 0 to 1.
        is_fallback: True if no candidate was certain, and the focus is the centre-weighted near part.

    Examples:
        >>> disparity = np.full((60, 90), 0.2, np.float32)
        >>> disparity[15:45, 30:55] = 0.8  # a card in front of a wall
        >>> card = find_subject(np.full((60, 90, 3), 0.5, np.float32), disparity)
        >>> card.note(Window.whole(90, 60))
        'focus on the subject at pixel 42,29 (`focus.at` changes it)'
    """

    position: tuple[int, int]
    mask: Mask
    disparity: float
    near: float
    far: float
    certainty: float
    is_fallback: bool

    def note(self, window: Window, supersampled: int = 1) -> str:
        """Return the choice of the focus as one line for a user.

        Args:
            window: Position of the map's pixels in the shown picture.
            supersampled: Size of the map relative to the result.
        """
        x, y = (
            (pixel + first) // supersampled
            for pixel, first in zip(self.position, (window.x, window.y), strict=True)
        )
        middle = "the nearer part of the middle, as no subject stands out,"
        goal = middle if self.is_fallback else "the subject"
        return f"focus on {goal} at pixel {x},{y} (`focus.at` changes it)"


def find_subject(
    image: Array,
    disparity: Array,
    *,
    faces: FaceDetector | None = None,
    search: SubjectSearch | None = None,
) -> Subject:
    """Return the subject of a picture.

    Args:
        image: Picture, scene-linear, (H, W, 3).
        disparity: Disparity of any unit, near is large, (h, w); another size than the picture's is allowed.
        faces: Detector of faces, such as :func:`bokehnet.scene.subject.detect_faces`; None for no faces.
        search: Tuned numbers.

    Raises:
        ShapeError, ParameterError: The map has a wrong shape, NaN or infinity.

    Examples:
        >>> disparity = np.full((60, 90), 0.2, np.float32)
        >>> disparity[15:45, 30:55] = 0.8  # a card in front of a wall
        >>> subject = find_subject(np.full((60, 90, 3), 0.5, np.float32), disparity)
        >>> subject.is_fallback, round(subject.disparity, 2), subject.position
        (False, 0.8, (42, 29))
    """
    check_map("disparity", disparity)
    search = search or SubjectSearch()
    view = View(image, np.asarray(disparity, np.float32), search)
    boxes = () if faces is None else view.scaled_boxes(faces(display(image)), image.shape[:2])
    candidates = surfaces_of_bands(view)
    scores = [score(view, mask, boxes) for mask in candidates]
    for index in np.argsort(scores)[::-1][:_MAX_FILLED]:
        scores[index] *= filled_fraction(view, candidates[index])
    best = int(np.argmax(scores)) if scores else -1
    certainty = certainty_of(scores[best]) if scores else 0.0
    if certainty < search.min_certainty:
        return _subject(view, fallback(view), certainty, is_fallback=True)
    return _subject(view, candidates[best], certainty, is_fallback=False)


def surface_around(disparity: Array, pixel: tuple[int, int], search: SubjectSearch | None = None) -> Subject:
    """Return the surface at a pixel, with the range of disparities of its connected part.

    Args:
        disparity: Disparity of any unit, near is large, (H, W).
        pixel: Column and row.
        search: Tuned numbers.

    Raises:
        ShapeError, ParameterError: The map has a wrong shape, NaN or infinity.

    Examples:
        >>> disparity = np.full((60, 90), 0.2, np.float32)
        >>> disparity[15:45, 30:55] = np.linspace(0.75, 0.8, 25)  # a card that is turned a little
        >>> card = surface_around(disparity, (40, 30))
        >>> round(card.far, 2), round(card.near, 2)
        (0.75, 0.8)
    """
    check_map("disparity", disparity)
    search = search or SubjectSearch()
    values = np.asarray(disparity, np.float32)
    view = View(np.zeros((*values.shape, 3), np.float32), values, search)
    row = min(int(pixel[1] * view.height / values.shape[0]), view.height - 1)
    column = min(int(pixel[0] * view.width / values.shape[1]), view.width - 1)
    seed = np.zeros((view.height, view.width), bool)
    seed[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2] = True
    middle = view.values[row, column]
    seed &= np.abs(view.values - middle) <= search.surface_step
    return _subject(view, grown(view, seed), 1.0, is_fallback=False)


def _subject(view: View, mask: Mask, certainty: float, *, is_fallback: bool) -> Subject:
    """Return the subject of a mask, grown to its connected surface unless that joins its surroundings."""
    surface = grown(view, mask)
    if surface.sum() > _MAX_GROWTH * mask.sum():  # into the surroundings
        surface = mask
    values = view.raw[surface]
    limit = view.search.max_range * view.span
    median = float(np.median(view.raw[mask]))
    far, near = (float(end) for end in np.percentile(values, (2, 98)))
    row, column = _middle_pixel(mask, np.abs(view.raw - median))
    height, width = view.full.shape
    position = int((column + 0.5) * width / view.width), int((row + 0.5) * height / view.height)
    return Subject(
        position=position,
        mask=surface,
        disparity=median,
        near=max(min(near, median + limit), median),
        far=min(max(far, median - limit), median),
        certainty=certainty,
        is_fallback=is_fallback,
    )


def _middle_pixel(mask: Mask, difference: Array) -> tuple[int, int]:
    """Return the pixel of a mask that is close to its centroid, inside, and of about its median disparity."""
    inner = mask
    for radius in (4, 2, 1):
        interior = eroded(mask, radius)
        if interior.any():
            inner = interior
            break
    typical = inner & (difference <= np.median(difference[inner]))
    rows, columns = np.nonzero(typical)
    all_rows, all_columns = np.nonzero(mask)
    distance = (rows - all_rows.mean()) ** 2 + (columns - all_columns.mean()) ** 2
    nearest = int(np.argmin(distance))
    return int(rows[nearest]), int(columns[nearest])

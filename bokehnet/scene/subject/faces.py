"""Detection of upright frontal faces."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.resample import resample

__all__ = ["FaceDetector", "detect_faces"]

Array = npt.NDArray[np.float32]

# Detector of faces: picture for display (H, W, 3) in [0, 1] to boxes (x, y, width, height) in pixels.
FaceDetector = Callable[[Array], Sequence[tuple[int, int, int, int]]]


def detect_faces(picture: Array) -> list[tuple[int, int, int, int]]:
    """Return boxes around upright frontal faces by local binary patterns; needs scikit-image.

    Args:
        picture: Picture for display, (H, W, 3), values in [0, 1].

    Returns:
        Boxes (x, y, width, height) in pixels; empty without faces or without scikit-image.

    Examples:
        >>> detect_faces(np.full((100, 150, 3), 0.5, np.float32))
        []

    References:
        Ahonen, Hadid, Pietikainen, "Face description with local binary patterns", 2006; Viola and Jones,
        "Rapid object detection using a boosted cascade of simple features", 2001.
    """
    try:
        from skimage.data import lbp_frontal_face_cascade_filename
        from skimage.feature import Cascade
    except ImportError:
        return []
    shrink = max(1.0, max(picture.shape[:2]) / 480)
    height, width = (max(round(side / shrink), 1) for side in picture.shape[:2])
    small = picture if shrink == 1 else resample(picture, height, width, "area")
    least = max(round(0.06 * max(height, width)), 24)
    if min(height, width) <= least:
        return []
    boxes = Cascade(lbp_frontal_face_cascade_filename()).detect_multi_scale(
        img=(255 * small).astype(np.uint8),
        scale_factor=1.2,
        step_ratio=1,
        min_size=(least, least),
        max_size=(min(height, width), min(height, width)),
        min_neighbor_number=6,
    )
    return [
        (
            round(box["c"] * shrink),
            round(box["r"] * shrink),
            round(box["width"] * shrink),
            round(box["height"] * shrink),
        )
        for box in boxes
    ]

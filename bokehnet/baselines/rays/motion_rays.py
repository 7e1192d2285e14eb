"""Motion blur as a post-process, and rays into the scene for what motion uncovers.

The post-process knows nothing behind a moving thing, and its blur ends at the outline. As selective rays do
for depth of field, rays over the exposure fill the pixels that an edge between two motions can reach.

Faults: the post-process keeps outlines sharp, and smears what is behind; rays are noisy where few.

Source: Marsicano, "Rendering real time depth of field effects", 2023, 6.0.2, proposes it; Rosado, "Motion
blur as a post-processing effect", GPU Gems 3, 2008, for the post-process; mask and fill are ours.
"""

from collections.abc import Callable

import numpy as np

from bokehnet.arrays.square_windows import dilated
from bokehnet.checks import check_above, check_map, check_whole
from bokehnet.errors import ShapeError

__all__ = ["fill_motion", "motion_blur", "motion_edges"]

# Function of pixels (N,), row by row; returns their mean light over the exposure, (N, 3).
TracePixels = Callable[[np.ndarray], np.ndarray]


def motion_blur(image: np.ndarray, motion: np.ndarray, samples: int = 16) -> np.ndarray:
    """Return the mean of pixels along each pixel's own motion.

    Args:
        image: Scene-linear picture at mid-exposure, (H, W, 3).
        motion: Displacement over the exposure, pixels (right, down), (H, W, 2).
        samples: Number of positions along the motion.

    Raises:
        ShapeError: The sizes differ.
        ParameterError: ``samples`` is below 1.
    """
    _check(image, motion)
    check_whole("samples", samples, 1)
    height, width = motion.shape[:2]
    y, x = np.mgrid[:height, :width]
    total = np.zeros(image.shape)
    for time in (np.arange(samples) + 0.5) / samples - 0.5:
        column, row = (np.rint(at + time * motion[..., k]).astype(int) for k, at in enumerate((x, y)))
        total += image[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    return np.asarray(total / samples, np.float32)


def motion_edges(motion: np.ndarray, min_difference: float = 1.0) -> np.ndarray:
    """Return the mask (H, W) of pixels that an edge between two motions reaches during the exposure.

    Args:
        motion: Displacement over the exposure, pixels, (H, W, 2).
        min_difference: Difference of two neighbours' motions at an edge, pixels.

    Raises:
        ParameterError: The difference is not above 0.
    """
    check_above("min_difference", min_difference, 0, "pixels")
    reach = np.zeros(motion.shape[:2])
    for axis in (0, 1):
        difference = np.linalg.norm(np.diff(motion, axis=axis), axis=-1) >= min_difference
        speed = np.linalg.norm(motion, axis=-1)
        first, second = (np.take(speed, range(k, k + difference.shape[axis]), axis) for k in (0, 1))
        edge = np.where(difference, np.maximum(first, second), 0)
        for k in (0, 1):
            window = [slice(None)] * 2
            window[axis] = slice(k, k + difference.shape[axis])
            reach[tuple(window)] = np.maximum(reach[tuple(window)], edge)
    # Half of the motion to either side of the position at mid-exposure.
    radii = np.ceil(reach / 2)
    mask = np.zeros(reach.shape, bool)
    for radius in np.unique(radii[radii > 0]):
        mask |= dilated(radii == radius, int(radius))
    return mask


def fill_motion(
    image: np.ndarray, motion: np.ndarray, trace_pixels: TracePixels, samples: int = 16
) -> np.ndarray:
    """Return the post-process with traced pixels at edges between motions.

    Args:
        image: Scene-linear picture at mid-exposure, (H, W, 3).
        motion: Displacement over the exposure, pixels (right, down), (H, W, 2).
        trace_pixels: Function of pixel numbers (N,), row by row, that returns their mean light over the
            exposure, (N, 3), from rays into the scene.
        samples: Number of positions of the post-process.

    Raises:
        ShapeError: The sizes differ.
        ParameterError: ``samples`` is below 1.
    """
    result = motion_blur(image, motion, samples)
    pixels = np.flatnonzero(motion_edges(motion))
    if len(pixels):
        result.reshape(-1, 3)[pixels] = trace_pixels(pixels)
    return result


def _check(image: np.ndarray, motion: np.ndarray) -> None:
    if motion.shape != (*image.shape[:2], 2):
        raise ShapeError(f"motion: expected shape {(*image.shape[:2], 2)}, got {motion.shape}")
    check_map("motion", motion[..., 0])
    check_map("motion", motion[..., 1])

"""Motion blur by a post-process and rays, against exact exposures of a moving square."""

import numpy as np
import pytest

from bokehnet.baselines.rays.motion_rays import fill_motion, motion_blur, motion_edges
from bokehnet.errors import ShapeError

HEIGHT, WIDTH, SHIFT = 24, 48, 8


def frame(offset: float) -> tuple[np.ndarray, np.ndarray]:
    """Stripes behind a square that starts at column 20 + offset; and where the square is."""
    x = np.arange(WIDTH)
    image = np.repeat((0.2 + 0.6 * (x // 2 % 2))[None, :, None], HEIGHT, 0).repeat(3, 2)
    inside = np.zeros((HEIGHT, WIDTH), bool)
    inside[6:18, round(20 + offset) : round(32 + offset)] = True
    image[inside] = (0.9, 0.1, 0.1)
    return image.astype(np.float32), inside


def exposure(count: int = 64) -> np.ndarray:
    return np.mean([frame(SHIFT * ((k + 0.5) / count - 0.5))[0] for k in range(count)], axis=0)


def moving():
    image, inside = frame(0)
    return image, np.where(inside[..., None], [float(SHIFT), 0.0], 0.0)


def test_the_post_process_is_its_mean_pixel_by_pixel():
    """Authority: Rosado's loop in plain Python."""
    image, motion = moving()
    expected = np.zeros(image.shape)
    for y, x in np.ndindex(HEIGHT, WIDTH):
        for k in range(4):
            column = round(x + ((k + 0.5) / 4 - 0.5) * motion[y, x, 0])
            expected[y, x] += image[y, min(max(column, 0), WIDTH - 1)] / 4
    assert motion_blur(image, motion, 4) == pytest.approx(expected, abs=1e-6)


def test_the_mask_holds_all_that_the_post_process_gets_wrong():
    """Authority: the exact exposure; outside of the mask the post-process is right."""
    image, motion = moving()
    error = np.abs(motion_blur(image, motion, 64) - exposure()).max(-1)
    mask = motion_edges(motion)
    assert error[mask].max() > 0.3
    assert error[~mask].max() < 1e-5
    # The square's outline moves by 4 pixels to either side: at most 12 + 2 * 5 by 12 + 2 * 5 pixels.
    assert mask.sum() <= 22 * 22


def test_rays_fill_what_motion_uncovers():
    """Authority: the exact exposure, which the rays return."""
    image, motion = moving()
    truth = exposure()
    filled = fill_motion(image, motion, lambda pixels: truth.reshape(-1, 3)[pixels], 64)
    assert filled == pytest.approx(truth, abs=1e-5)


def test_without_motion_nothing_changes():
    image, motion = moving()
    assert np.array_equal(fill_motion(image, 0 * motion, lambda pixels: 1 / 0), image)


def test_other_sizes_are_an_error():
    image, motion = moving()
    with pytest.raises(ShapeError, match="motion"):
        motion_blur(image, motion[1:])

"""An F cut from paper before a lens, as the lens of the ray tracer sends light and as `rays` shows it."""

import numpy as np
import pytest

from bokehnet.classical.rays_renderer import rays
from bokehnet.lenses import ThinLens
from bokehnet.optics.aperture import Aperture

# Right and down as seen from behind the camera.
LETTER = np.kron([[1, 1, 1], [1, 0, 0], [1, 1, 0], [1, 0, 0], [1, 0, 0]], np.ones((8, 8)))
SIDE, PITCH = 41, 0.05


def traced(lens: ThinLens, depth: float) -> np.ndarray:
    """Light of each pixel from a small lamp on the axis, by rays through each point of the opening."""
    place = (np.arange(SIDE) - SIDE // 2) * PITCH
    # The sensor shows the scene turned by 180 degrees: the pixel on the right lies on its left.
    sensor_xy = -np.stack(np.meshgrid(place, place), -1)[..., None, :]
    rows, columns = np.nonzero(LETTER)
    height, width = LETTER.shape
    pupil_uv = np.stack([(2 * columns + 1 - width) / height, (2 * rows + 1 - height) / height], -1)
    pupil_uv = pupil_uv[(pupil_uv**2).sum(-1) <= 1]
    result = lens.sample_rays(*np.broadcast_arrays(sensor_xy, pupil_uv))
    at_lamp = result.origin + depth * result.slope
    lamp = 1.2 * PITCH * depth / lens.sensor_distance
    return ((at_lamp**2).sum(-1) < lamp**2).mean(-1)


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    return float((one * other).sum() / np.sqrt((one**2).sum() * (other**2).sum()))


@pytest.mark.parametrize("depth", [1200.0, 6000.0])
def test_an_f_is_upright_behind_focus_and_turned_in_front_of_it(depth):
    """A blur is the opening's picture scaled by A (1 - zf / z), A as seen from behind the camera."""
    lens = ThinLens(focal_length=50.0, f_number=1.4, focus_distance=2500.0)
    defocus = float(lens.coc_radius(1 / depth)) / PITCH
    image = np.zeros((SIDE, SIDE, 3), np.float32)
    image[SIDE // 2, SIDE // 2] = 1
    blur = np.full((SIDE, SIDE), defocus, np.float32)
    shown = rays(image, blur, aperture=Aperture(picture=LETTER))[..., 0]
    expected = traced(lens, depth)
    assert correlation(shown, expected) > 0.95
    assert correlation(shown[::-1, ::-1], expected) < 0.85
    upright = shown if depth > lens.focus_distance else shown[::-1, ::-1]
    rows, columns = np.nonzero(upright > 0.5 * upright.max())
    assert rows.mean() < SIDE // 2  # the F is heavy at its top left
    assert columns.mean() < SIDE // 2

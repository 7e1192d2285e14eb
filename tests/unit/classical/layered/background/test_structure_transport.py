"""Lines behind what hides them. Authority: pictures whose hidden part is known by construction."""

import numpy as np
import pytest

from bokehnet.classical.layered.background.occluded_background import occluded_background

HEIGHT, WIDTH = 80, 120
BAR = slice(50, 70)


def stripes(degrees: float, period: float = 14.0) -> np.ndarray:
    """Grey stripes along a direction, smooth across it, (H, W, 3)."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    angle = np.deg2rad(degrees)
    across = np.cos(angle) * y - np.sin(angle) * x
    return np.repeat((0.4 + 0.3 * np.sin(2 * np.pi * across / period))[..., None], 3, 2).astype(np.float32)


def behind_a_bar(background: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    image, defocus = background.copy(), np.full((HEIGHT, WIDTH), -3.0, np.float32)
    image[:, BAR], defocus[:, BAR] = (0.1, 0.6, 0.1), 20.0
    return image, defocus


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("degrees", [0, 20, -35, 50])
def test_stripes_go_on_at_their_angle(degrees):
    truth = stripes(degrees)
    colors, _ = occluded_background(*behind_a_bar(truth))
    rim = np.s_[20:60, 50:55]  # its borders are seen at the left edge
    assert rms(colors[rim] - truth[rim]) < 0.3 * rms(truth[rim] - truth[rim].mean())


def test_an_oblique_edge_goes_on_and_fades():
    """A wall's lower end behind a bar: sharp where it goes in, uncertain in the middle of the bar."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    truth = np.repeat(np.where(y > 20 + 0.4 * x, 0.1, 0.7)[..., None], 3, 2).astype(np.float32)
    colors, _ = occluded_background(*behind_a_bar(truth))
    wrong = [rms(colors[24:60, column] - truth[24:60, column]) for column in (51, 59)]
    assert wrong[0] < 0.12
    assert wrong[0] < wrong[1] < 0.25


def test_noise_is_taken_for_no_lines():
    """Behind noise the best guess is its mean, which is what the means of the surroundings are near to."""
    noise = np.random.default_rng(3).uniform(0.2, 0.6, (HEIGHT, WIDTH, 3)).astype(np.float32)
    colors, _ = occluded_background(*behind_a_bar(noise))
    inner = colors[20:60, 52:58]
    assert abs(inner.mean() - 0.4) < 0.02
    assert inner.std() < 0.4 * noise.std()


def test_only_the_hidden_surface_is_carried_on():
    """Beside the bar stands a red post nearer than the wall: nothing of it shows behind the bar."""
    image, defocus = behind_a_bar(stripes(30))
    image[:, 40:46], defocus[:, 40:46] = (1.0, 0.0, 0.0), 9.0
    colors, depths = occluded_background(image, defocus)
    hidden = np.s_[20:60, 50:56]
    assert (depths[hidden] == -3.0).all()
    red = colors[hidden][..., 0] - colors[hidden][..., 1]
    assert np.abs(red).max() < 1e-5

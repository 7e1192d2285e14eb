"""Steps of less than a pixel of defocus are steps: their edges blur and move as those of two surfaces."""

import numpy as np
import pytest

from bokehnet.classical.layered.boundaries import mixed_pixels
from bokehnet.classical.layered.depth_discontinuities import BACK, FRONT, discontinuity_sides
from bokehnet.classical.layered.layers import split_layers
from bokehnet.classical.layered.slight_steps import MIN_STEP_PX, SLIGHT, half_step, sides_with_slight_steps
from bokehnet.engines.options import RenderOptions
from bokehnet.optics.pixels.pixel_filter import PixelFilter
from bokehnet.render.renderer import BokehRenderer

HEIGHT, WIDTH = 24, 40
BOX = PixelFilter("box", 1.0)


def straight_edge(place: float, near: float, far: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """White before black, the edge so far from the left: all in focus, defocus, and with bokeh.

    Authority: what a lens makes of a half plane before one colour is the half plane moved by the defocus of
    the nearer surface to every place of the disc; here summed over 400 chords and averaged over each pixel.
    """

    def shown(edge: np.ndarray) -> np.ndarray:
        """White's share of the pixels of a row, the edge at each of these places, (N, WIDTH)."""
        return np.clip(edge[:, None] - np.arange(WIDTH), 0, 1)

    across = (np.arange(400) + 0.5) / 200 - 1
    chords = np.sqrt(1 - across**2)
    row = chords @ shown(place + near * across) / chords.sum()
    sharp = shown(np.array([place]))[0]
    defocus = np.where(np.arange(WIDTH) + 0.5 < place, near, far)
    picture, truth = (np.repeat(np.tile(x, (HEIGHT, 1))[..., None], 3, -1) for x in (sharp, row))
    defocus = np.tile(defocus, (HEIGHT, 1))
    return picture.astype(np.float32), defocus.astype(np.float32), truth.astype(np.float32)


def too_wide(image: np.ndarray, defocus: np.ndarray, truth: np.ndarray) -> float:
    """By how many pixels more white is seen than in truth; rows and columns of the border left out."""
    render = (
        BokehRenderer("rays").render_arrays(image, defocus, options=RenderOptions(pixel_filter=BOX)).bokeh
    )
    return float((render - truth)[6:-6, 12:-12].mean(axis=(0, 2)).sum())


@pytest.mark.parametrize(("near", "far"), [(0.9, 0.0), (0.0, -0.9), (3.0, 2.2), (-2.0, -2.8)])
def test_what_is_less_than_a_pixel_of_defocus_nearer_is_not_seen_wider(near, far, monkeypatch):
    """Taken for a slope it is 0.13 pixels too wide."""
    results, before = [], []
    for place in (19.6, 20.0, 20.3):
        edge = straight_edge(place, near, far)
        results.append(too_wide(*edge))
        with monkeypatch.context() as patch:
            patch.setattr(mixed_pixels, "sides_with_slight_steps", discontinuity_sides)
            before.append(too_wide(*edge))
    assert np.mean(before) == pytest.approx(0.127, abs=0.01)
    assert abs(np.mean(results)) < 0.2 * np.mean(before)  # 0.02 pixels, as at larger steps


def test_slopes_are_no_steps_and_steps_on_slopes_are():
    """Authority: by hand. A step counts where it exceeds the least and twice what the slope gives."""
    x = np.arange(WIDTH, dtype=np.float32)
    for slope in (0.2, 0.5, 0.9):
        assert not sides_with_slight_steps(np.tile(slope * x, (HEIGHT, 1)), 1).any()
    stepped = np.tile(0.05 * x + np.float32(0.6) * (x >= 20), (HEIGHT, 1))
    marked = np.nonzero(sides_with_slight_steps(stepped, 1)[5] == SLIGHT)[0]
    assert list(marked) == [19, 20]
    flat = np.tile(np.float32(0.9 * MIN_STEP_PX) * (x >= 20), (HEIGHT, 1))
    assert not sides_with_slight_steps(flat, 1).any()


def test_a_pixel_at_a_larger_step_is_no_slight_one():
    defocus = np.zeros((HEIGHT, WIDTH), np.float32)
    defocus[:, 17:], defocus[:, 21:] = 0.6, 3.0
    sides = sides_with_slight_steps(defocus, 1)
    assert list(sides[5, 16:22]) == [SLIGHT, SLIGHT, 0, 0, BACK, FRONT]
    np.testing.assert_array_equal(sides & ~SLIGHT, discontinuity_sides(defocus))


def test_what_belongs_to_either_surface_is_nearer_to_it():
    assert half_step(0.8, 0.2) == pytest.approx(0.3)
    assert half_step(5.0, 0.0) == 1.0


def test_a_slight_step_keeps_the_farther_background():
    """A foreground of two depths hides a far background: no hole is made in it near its edge."""
    image = np.random.default_rng(3).uniform(0, 1, (HEIGHT, WIDTH, 3)).astype(np.float32)
    defocus = np.zeros((HEIGHT, WIDTH), np.float32)
    defocus[:, 10:], defocus[:, 14:] = 9.0, 9.6
    layers = split_layers(image, defocus)
    assert layers.defocus[12, 13, 1] < 1  # the background, and not the other half of the foreground
    assert layers.coverage[12, 13, 0] == 1
    np.testing.assert_array_equal(layers.colors[12, 13, 0], image[12, 13])
    alone = split_layers(image, np.where(defocus > 0, defocus, 9.0).astype(np.float32))
    assert alone.defocus[12, 14, 1] == pytest.approx(9.0)

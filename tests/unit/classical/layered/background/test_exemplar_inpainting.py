"""Texture behind what hides it. Authority: pictures whose hidden part is known by construction."""

import importlib

import numpy as np
import pytest

from bokehnet.classical.layered.background.exemplar_inpainting import inpaint_texture
from bokehnet.classical.layered.background.inpainting_order import occluded_rings
from bokehnet.classical.layered.background.occluded_background import occluded_background

filling = importlib.import_module("bokehnet.classical.layered.background.occluded_background")

HEIGHT, WIDTH = 80, 120
BAR = slice(50, 70)
RIM = np.s_[20:60, 50:56]


def checks(side: int = 4) -> np.ndarray:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.repeat((0.2 + 0.5 * ((y // side + x // side) % 2))[..., None], 3, 2).astype(np.float32)


def dots() -> np.ndarray:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    inside = np.hypot(y % 9 - 4, (x + 3 * (y // 9)) % 9 - 4) < 2.6
    return np.where(inside[..., None], (0.7, 0.2, 0.1), (0.2, 0.3, 0.5)).astype(np.float32)


def clouds() -> np.ndarray:
    smooth = np.random.default_rng(3).normal(size=(HEIGHT, WIDTH, 3))
    for axis in (0, 1, 0, 1):
        smooth = sum(np.roll(smooth, shift, axis) for shift in range(-2, 3))
    return (0.1 + 0.7 * (smooth - smooth.min()) / np.ptp(smooth)).astype(np.float32)


def behind_a_bar(background: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    image, defocus = background.copy(), np.full((HEIGHT, WIDTH), -3.0, np.float32)
    image[:, BAR], defocus[:, BAR] = (0.1, 0.6, 0.1), 20.0
    return image, defocus


def look_alikes(image: np.ndarray, defocus: np.ndarray, lights: np.ndarray | None = None) -> np.ndarray:
    """Behind the bar, all of whose pixels hide the plane around it."""
    columns = np.arange(WIDTH)
    distances = np.where(defocus == 20, np.minimum(columns - 49, 70 - columns), 0).astype(np.float32)
    depths = np.where(defocus == 20, np.float32(-3), defocus)
    means = np.full_like(image, 0.45)
    lights = np.zeros(defocus.shape, bool) if lights is None else lights
    return inpaint_texture(image, defocus, lights, depths, distances, occluded_rings(distances), means)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_a_small_pattern_goes_on_as_it_is():
    truth = checks(3)
    result = look_alikes(*behind_a_bar(truth))
    assert rms(result[RIM] - truth[RIM]) < 0.01


@pytest.mark.parametrize("texture", [checks, dots, clouds])
def test_textures_are_nearer_to_the_truth_than_lines_alone(monkeypatch, texture):
    truth = texture()
    both, _ = occluded_background(*behind_a_bar(truth))
    monkeypatch.setattr(filling, "inpaint_texture", lambda *arguments: arguments[-1])
    lines, _ = occluded_background(*behind_a_bar(truth))
    rim = np.s_[20:60, 50:53]
    assert rms(both[rim] - truth[rim]) < 0.92 * rms(lines[rim] - truth[rim])


def test_nothing_but_the_hidden_surface_is_taken():
    """A post nearer than the plane, of another colour, and a light stand beside the bar."""
    image, defocus = behind_a_bar(checks())
    image[:, 42:46], defocus[:, 42:46] = (1.0, 0.0, 0.0), 9.0
    lights = np.zeros(defocus.shape, bool)
    image[30:34, 46:49], lights[30:34, 46:49] = (0.0, 0.0, 50.0), True
    result = look_alikes(image, defocus, lights)
    assert np.ptp(result[:, BAR], axis=2).max() < 1e-6


def test_what_nothing_is_like_keeps_the_other_guess():
    """Everything beside the bar is another surface than the one behind it."""
    image, defocus = behind_a_bar(checks())
    defocus[:, : BAR.start] = defocus[:, BAR.stop :] = 3.0
    result = look_alikes(image, np.where(defocus == 3, np.float32(3), defocus))
    assert (result[:, BAR] == np.float32(0.45)).all()


def test_a_part_of_the_picture_gives_what_the_whole_does():
    """So that strips join, and textures move with what moves."""
    image, defocus = behind_a_bar(dots())
    whole, part = look_alikes(image, defocus), look_alikes(image[7:], defocus[7:])
    assert np.array_equal(part[45:, BAR], whole[52:, BAR])


def test_nothing_hidden_is_nothing_to_do():
    image, defocus = dots(), np.zeros((HEIGHT, WIDTH), np.float32)
    colors, depths = occluded_background(image, defocus)
    assert np.array_equal(colors, image)
    assert np.array_equal(depths, defocus)

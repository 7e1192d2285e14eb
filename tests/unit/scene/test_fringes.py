"""Coverage along soft silhouettes, against composed pictures whose true coverage is known."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from bokehnet.scene.fringes import fringe_surfaces

HEIGHT, WIDTH = 256, 384


def _strands(rng: np.random.Generator) -> np.ndarray:
    """Return the coverage (H, W) of a region whose right border consists of strands of a pixel or two."""
    column = np.arange(WIDTH)[None]
    ends = 190 + 8 * gaussian_filter(rng.standard_normal(HEIGHT), 0.7, mode="wrap")[:, None]
    return gaussian_filter(np.clip(ends - column, 0, 1), 0.5)


def _composed(coverage: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a dark textured surface over a bright one, scene-linear, (H, W, 3)."""
    texture = 1 + 0.1 * gaussian_filter(rng.standard_normal((HEIGHT, WIDTH, 1)), (1, 1, 0))
    front, back = np.array([0.06, 0.03, 0.02]) * texture, np.array([0.4, 0.5, 0.6]) * texture
    alpha = coverage[..., None]
    return (alpha * front + (1 - alpha) * back).astype(np.float32)


@pytest.mark.parametrize("scale", [1, 3])
def test_coverage_of_strands_is_closer_to_the_truth_than_the_map(scale: int) -> None:
    rng = np.random.default_rng(3)
    coverage = _strands(rng)
    image = _composed(coverage, rng)
    disparity = np.zeros((HEIGHT, WIDTH), np.float32)
    disparity[:, :188] = 2.0  # no strands
    image, disparity, coverage = (
        np.repeat(np.repeat(array, scale, 0), scale, 1) for array in (image, disparity, coverage)
    )
    known = fringe_surfaces(image, disparity)
    assert known is not None
    truth, of_map = coverage[known.rows, known.columns], disparity[known.rows, known.columns] / 2
    assert np.abs(known.coverage - truth).mean() < 0.6 * np.abs(of_map - truth).mean()
    assert (known.near == 2).all()
    assert (known.far == 0).all()
    assert known.front is None


def test_sharp_silhouette_with_an_exact_map_is_left_alone() -> None:
    rng = np.random.default_rng(4)
    row, column = np.mgrid[:HEIGHT, :WIDTH]
    disc = (np.hypot(row - 128, column - 192) < 70).astype(np.float32)
    assert fringe_surfaces(_composed(disc, rng), disc) is None


def test_sides_of_the_same_colours_are_left_alone() -> None:
    rng = np.random.default_rng(5)
    image = 0.3 * np.exp(gaussian_filter(rng.standard_normal((HEIGHT, WIDTH, 3)), (1, 1, 0)))
    disparity = (np.arange(WIDTH) < 190).astype(np.float32) * np.ones((HEIGHT, 1), np.float32)
    assert fringe_surfaces(image.astype(np.float32), disparity) is None


def test_random_map_is_left_alone() -> None:
    rng = np.random.default_rng(6)
    image = rng.random((HEIGHT, WIDTH, 3), np.float32)
    assert fringe_surfaces(image, rng.random((HEIGHT, WIDTH), np.float32)) is None


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (9, 9)])
def test_tiny_pictures_are_left_alone(shape: tuple[int, int]) -> None:
    disparity = np.zeros(shape, np.float32)
    disparity[: shape[0] // 2] = 1
    assert fringe_surfaces(np.full((*shape, 3), 0.5, np.float32), disparity) is None

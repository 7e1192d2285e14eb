"""Coverage along soft silhouettes, against composed pictures whose true coverage is known."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.io.image import write_image, write_map
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.fringes import fringe_surfaces
from bokehnet.scene.scene import read_scene
from bokehnet.settings.settings import RenderSettings

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


def test_lamps_are_no_mixture_of_two_surfaces(tmp_path, monkeypatch) -> None:
    """A clipped lamp keeps its light, although its outline looks soft; its neighbours are estimated."""
    rng = np.random.default_rng(6)
    image = (0.004 * (1 + 0.3 * rng.random((96, 128, 1))) * np.ones(3)).astype(np.float32)
    disparity = np.zeros((96, 128), np.float32)
    for row in range(12, 96, 24):
        for column in range(12, 128, 24):
            image[row - 2 : row + 3, column - 2 : column + 3] = 1
            disparity[row - 1 : row + 2, column - 1 : column + 2] = 0.5
    disparity[60:, :20] = 1
    write_image(tmp_path / "night.png", image)
    write_map(tmp_path / "map.png", disparity)

    def everywhere(image: np.ndarray, disparity: np.ndarray) -> KnownSurfaces:
        rows, columns = (index.reshape(-1) for index in np.indices(disparity.shape))
        half = np.full(rows.shape, 0.5, np.float32)
        return KnownSurfaces(rows=rows, columns=columns, near=2 * half, far=0 * half, coverage=half)

    monkeypatch.setattr("bokehnet.scene.preparation.preparation.fringe_surfaces", everywhere)
    changes = {"camera": {"blur": 12}, "focus": {"value": 1.0}, "input": {"disparity": tmp_path / "map.png"}}
    settings = RenderSettings().updated(changes)
    known = BokehRenderer().prepare(read_scene(tmp_path / "night.png", settings), settings).known
    is_estimated = np.zeros(disparity.shape, bool)
    is_estimated[known.rows, known.columns] = True
    middles = np.zeros(disparity.shape, bool)
    middles[12::24, 12::24] = True
    assert not is_estimated[middles].any()
    assert is_estimated[image.max(-1) < 0.5].all()

"""Fit of surface values in the whole repair: no harm where something else than blur is wrong.

Authority: the map before it was degraded; the repair without this stage.
"""

import numpy as np
import pytest

from bokehnet.depth_repair.config import STAGES, RepairConfig
from bokehnet.depth_repair.repair import DisparityRepair

ndimage = pytest.importorskip("scipy.ndimage")
HEIGHT, WIDTH = 160, 224

# Maximum mean error that the stage may add, as a fraction of the range of the map.
MAX_ADDED_ERROR = 3e-4


@pytest.fixture(scope="module")
def repairs():
    """Return the repair with and without the fit of values."""
    without = RepairConfig(stages=frozenset(STAGES) - {"values"})
    return DisparityRepair(), DisparityRepair(config=without)


def scene(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a textured picture and its map: inclined ground, discs and bars at random places."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    truth = 0.1 + 0.15 * y / HEIGHT
    surface = np.zeros((HEIGHT, WIDTH), int)
    for number in range(1, 9):
        row, column, value = rng.uniform(20, HEIGHT - 20), rng.uniform(20, WIDTH - 20), rng.uniform(0.4, 1)
        if number % 2:
            inside = np.hypot(y - row, x - column) < rng.uniform(8, 22)
        else:
            angle, half_width = rng.uniform(0, np.pi), rng.uniform(1.5, 4)
            across = (y - row) * np.sin(angle) + (x - column) * np.cos(angle)
            along = (y - row) * np.cos(angle) - (x - column) * np.sin(angle)
            inside = (np.abs(across) < half_width) & (np.abs(along) < 45)
        surface[inside], truth[inside] = number, value
    colors = rng.uniform(0.1, 0.8, (9, 3))
    texture = ndimage.gaussian_filter(rng.standard_normal((HEIGHT, WIDTH)), 1.2)
    image = colors[surface] * np.exp(0.5 * texture / texture.std())[..., None]
    return image.astype(np.float32), truth.astype(np.float32)


def jagged(truth: np.ndarray) -> np.ndarray:
    """Return the map with edges displaced by a smooth random field of up to three pixels."""
    rng = np.random.default_rng(9)
    fields = [ndimage.gaussian_filter(rng.standard_normal(truth.shape), 8) for _ in range(2)]
    places = np.mgrid[:HEIGHT, :WIDTH] + [3 * field / np.abs(field).max() for field in fields]
    return ndimage.map_coordinates(truth, places, order=0, mode="nearest")


DEGRADATIONS = {
    "blurred": lambda d: d,
    "displaced": lambda d: np.roll(d, (1, 2), (0, 1)),
    "grown": lambda d: ndimage.maximum_filter(d, 3),
    "shrunk": lambda d: ndimage.minimum_filter(d, 3),
    "jagged": jagged,
}


def errors(repairs, seed: int, name: str, deviation: float) -> list[float]:
    """Return the mean error with and without the stage."""
    image, truth = scene(seed)
    wrong = ndimage.gaussian_filter(DEGRADATIONS[name](truth), deviation)
    maps = [repair.repair(image, wrong, "auto").disparity for repair in repairs]
    return [float(np.abs(values - truth).mean()) for values in maps]


@pytest.mark.parametrize("name", DEGRADATIONS)
@pytest.mark.parametrize(("seed", "deviation"), [(11, 2.5), (12, 2.5), (22, 3.5)])
def test_the_fit_of_values_does_no_harm(repairs, seed, name, deviation):
    fitted, without = errors(repairs, seed, name, deviation)
    assert fitted - without <= MAX_ADDED_ERROR


@pytest.mark.parametrize("name", ["blurred", "displaced"])
def test_the_fit_of_values_lowers_the_error_of_blurred_bars(repairs, name):
    """The registration corrects the displacement first."""
    fitted, without = errors(repairs, 11, name, 2.5)
    assert fitted < 0.8 * without

"""A folder with a small photo, its disparity and its depth, for tests from scenes to renderers."""

import numpy as np
import pytest

from bokehnet.io.image import write_image, write_map

WIDTH, HEIGHT = 64, 40


@pytest.fixture
def photo():
    """Noise, (H, W, 3), scene-linear."""
    return np.random.default_rng(0).random((HEIGHT, WIDTH, 3), dtype=np.float32)


@pytest.fixture
def steps():
    """Relative disparity, (H, W), that bytes hold exactly: 0, 102/255, 1."""
    disparity = np.zeros((HEIGHT, WIDTH), np.float32)
    disparity[:, 20:] = 102 / 255
    disparity[:, 44:] = 1
    return disparity


@pytest.fixture
def folder(tmp_path, monkeypatch, photo, steps, write_channels):
    """Work in a folder with photo.exr, disparity.png and depth.exr (Z in metres, sky at infinity)."""
    monkeypatch.chdir(tmp_path)
    write_channels("photo.exr", R=photo[..., 0], G=photo[..., 1], B=photo[..., 2])
    write_image("photo.png", photo)
    write_map("disparity.png", steps)
    with np.errstate(divide="ignore"):
        write_channels("depth.exr", Z=1 / steps, far=1 / steps + 2)
    return tmp_path

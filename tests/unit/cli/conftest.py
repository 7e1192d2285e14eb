import contextlib

import numpy as np
import pytest

from bokehnet.io.image import write_image, write_map

WIDTH, HEIGHT = 64, 40


@pytest.fixture
def no_bar(monkeypatch):
    """Commands show no bar and no notice, also where numba compiles first or the machine is busy."""
    monkeypatch.setattr("bokehnet.cli.progress._DELAY", 300.0)
    monkeypatch.setattr("bokehnet.cli.progress.compile_notice", lambda hidden=False: contextlib.nullcontext())


@pytest.fixture
def on_terminal(monkeypatch):
    """Stderr is a terminal, on which bars appear without a delay."""
    monkeypatch.setattr("bokehnet.cli.progress._stderr_is_terminal", lambda: True)
    monkeypatch.setattr("bokehnet.cli.progress._DELAY", 0.0)


@pytest.fixture
def folder(tmp_path, monkeypatch, write_channels, no_bar):
    """Work in a folder with photo.png, disparity.png (3 steps), camera.exr (R, G, B, Z, far), all 64x40."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    photo = rng.random((HEIGHT, WIDTH, 3), dtype=np.float32)
    disparity = np.zeros((HEIGHT, WIDTH))
    disparity[:, 20:] = 102 / 255
    disparity[:, 44:] = 1
    metres = np.where(disparity == 0, np.inf, 1 / np.maximum(disparity, 0.1)).astype(np.float32)
    write_image("photo.png", photo)
    write_map("disparity.png", disparity)
    write_channels("camera.exr", R=photo[..., 0], G=photo[..., 1], B=photo[..., 2], Z=metres, far=metres + 2)
    return tmp_path


def snapshot(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def fails(folder, cli):
    """Assert that a command line fails as it shall: without, and then with an older output file."""

    def check(arguments, *words, output="out.png"):
        for older in (False, True):
            if older and (not (folder / output).parent.is_dir() or (folder / output).exists()):
                return
            if older:
                (folder / output).write_bytes(b"older")
            before = snapshot(folder)
            outcome = cli(*arguments, "-o", output)
            assert (outcome.code, outcome.out) == (1, "")
            assert outcome.err.startswith("bokehnet: error: ")
            assert outcome.err.count("\n") == 1
            assert outcome.err.endswith("\n")
            for word in words:
                assert word in outcome.err
            assert snapshot(folder) == before
            assert not (folder / "maps").exists()

    return check


SCENE = """
[camera]
width = 24
height = 16
[lens]
focal_length = 50.0
f_number = 1.4
focus_distance = 1.2
[render]
samples = 8
bounces = 1
[environment]
color = [0.5, 0.5, 0.5]
[[quads]]
name = "floor"
centre = [0.0, 0.1, 2.0]
u_axis = [1.0, 0.0, 0.0]
v_axis = [0.0, 0.0, 1.0]
material = { color = [0.5, 0.4, 0.3] }
[[spheres]]
name = "ball"
centre = [0.0, 0.0, 1.2]
radius = 0.1
material = { color = [0.2, 0.5, 0.5], specular = [0.2, 0.2, 0.2] }
"""


@pytest.fixture
def scene(tmp_path, no_bar):
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"

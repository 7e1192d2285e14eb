"""Clipped light in the studio: note, overlay of what was recovered, slider of its strength."""

import numpy as np
import pytest

from bokehnet.io.image import write_image, write_map

from .conftest import Studio, until
from .test_studio_page import await_command, put

LAMPS = ((30, 40), (36, 130), (84, 150))


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A night street: clipped lamps before a dark wall, a near post."""
    pytest.importorskip("starlette", reason="needs the extra studio")
    folder = tmp_path_factory.mktemp("night")
    rng = np.random.default_rng(2)
    light = 0.006 * (1 + 0.1 * rng.standard_normal((120, 180, 1))) * np.ones(3)
    y, x = np.mgrid[:120, :180]
    for row, column in LAMPS:
        light += 12 * np.clip(3.5 - np.hypot(y - row, x - column), 0, 1)[..., None]
    near = np.full((120, 180), 0.1, np.float32)
    near[60:, 80:100] = 0.9
    write_image(folder / "night.png", np.clip(light, 0, 1).astype(np.float32))
    write_map(folder / "map.png", near)
    options = ("--disparity", folder / "map.png", "--blur", 12, "--focus", 0.9, "--repair-disparity", "off")
    result = Studio(folder / "night.png", *options)
    yield result
    result.end()


def test_overlay_and_strength_of_recovered_light(page, pixels, settle):
    until(page, "document.querySelector('#light-note').textContent.includes('x white')")
    page.click("#show-light")
    middle = f"{LAMPS[0][1]}, {LAMPS[0][0]}"
    until(page, f"document.querySelector('#over').getContext('2d').getImageData({middle}, 1, 1).data[0] > 0")
    shown = pixels(page, "#over")[..., :3].sum(-1)  # black where there is no light
    assert all(shown[row, column] > 0 for row, column in LAMPS)
    assert shown[5, 5] == shown[110, 90] == 0
    settle(page, lambda: put(page, "#focus", 0.9))  # the fixture focuses on the wall
    means = []
    for strength in (0, 0.1, 0.3):
        put(page, "#light", strength)
        await_command(page, f"--highlight-strength {strength}")
        means.append(float(pixels(page)[24:37, 34:47, :3].mean()))
    assert means[0] < means[1] - 5
    assert means[1] < means[2] - 5

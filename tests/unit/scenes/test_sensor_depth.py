"""Depth along the normal of a tilted sensor, against walls parallel to it."""

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.io.channels import read_channels
from bokehnet.lenses import ThinLens, TiltShift
from bokehnet.raytrace.camera import Camera
from bokehnet.scenes.sensor_depth import depth_along_sensor

# Axes of the wall, and its middle in m: parallel to a sensor tilted by 20 degrees about x, 1.5 m along its
# normal (0, sin 20, cos 20).
COS, SIN = math.cos(math.radians(20)), math.sin(math.radians(20))
SCENE = f"""
[camera]
width = 12
height = 8
tilt = [20.0, 0.0]

[lens]
focal_length = 50.0
f_number = 4.0
focus_distance = 1.5

[[quads]]
centre = [0.0, {1.5 * SIN}, {1.5 * COS}]
u_axis = [9.0, 0.0, 0.0]
v_axis = [0.0, {9 * COS}, {-9 * SIN}]
material = {{ emission = [1.0, 1.0, 1.0] }}
"""


@pytest.mark.parametrize("layers", [False, True])
def test_a_wall_parallel_to_the_sensor_has_one_depth_in_the_file(tmp_path, cli, layers):
    (tmp_path / "wall.toml").write_text(SCENE)
    words = ["trace", tmp_path / "wall.toml", "-o", tmp_path / "wall.exr", "--samples", 1]
    assert cli(*words, *(["--layers", 1] if layers else [])).code == 0
    channels = read_channels(tmp_path / "wall.exr").channels
    assert_allclose(channels["layer1.Z" if layers else "Z"], 1.5, rtol=1e-5)
    if not layers:
        assert_allclose(channels["disparity"], 1 / 1.5, rtol=1e-5)


def test_an_upright_sensor_counts_depth_as_its_lens_does():
    depth = torch.rand(8, 12)
    lens = ThinLens(focal_length=50.0, f_number=4.0)
    for same in (lens, TiltShift(lens=lens, shift=(3.0, 1.0))):
        camera = Camera(lens=same, width=12, height=8, pixel_pitch=3.0)
        assert depth_along_sensor(camera, depth) is depth


def test_what_is_infinitely_far_stays_there():
    lens = TiltShift(lens=ThinLens(focal_length=50.0, f_number=4.0), tilt=(5.0, -9.0))
    camera = Camera(lens=lens, width=12, height=8, pixel_pitch=3.0)
    assert bool((depth_along_sensor(camera, torch.full((8, 12, 2), math.inf)) == math.inf).all())


def test_about_the_middle_depth_is_that_of_the_normal():
    """Authority: a point on the lens's axis is cos(tilt) as far along the normal, both tilts together."""
    lens = TiltShift(lens=ThinLens(focal_length=50.0, f_number=4.0), tilt=(7.0, -30.0))
    camera = Camera(lens=lens, width=1, height=1, pixel_pitch=3.0)
    result = float(depth_along_sensor(camera, torch.tensor([[2000.0]], dtype=torch.float64)))
    assert result == pytest.approx(2000 * np.cos(np.radians(7)) * np.cos(np.radians(30)), rel=1e-12)

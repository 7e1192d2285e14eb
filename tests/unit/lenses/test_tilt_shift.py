"""Tilted and shifted sensors against Scheimpflug and against the untilted lens."""

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.errors import LensError
from bokehnet.lenses import ThickLens, ThinLens, TiltShift, load_lens
from bokehnet.optics.sampling import disc_from_square, halton

THIN = ThinLens(focal_length=50.0, f_number=1.4, focus_distance=1000.0)
THICK = ThickLens(focal_length=50.0, f_number=1.4, focus_distance=1000.0, principal_depth=-20.0)
# On the plane z = 1200 + 0.8 x - 1.5 y.
POINTS = np.array([[-200.0, 100.0, 890.0], [300.0, -50.0, 1515.0], [50.0, -300.0, 1690.0]])
UV = disc_from_square(np.stack([halton(64, 2), halton(64, 3)], -1))


def test_without_tilt_and_shift_nothing_changes():
    xy = 10 * UV
    a, b = THIN.sample_rays(xy, UV), TiltShift(lens=THIN).sample_rays(xy, UV)
    assert_allclose(b.slope, a.slope, atol=1e-15)
    assert TiltShift(lens=THIN).coc_radius(0.002) == THIN.coc_radius(0.002)


@pytest.mark.parametrize("lens", [THIN, THICK])
def test_every_point_of_the_plane_through_three_points_is_sharp(lens):
    """All rays of a sensor point meet in the plane, wherever they leave the pupil."""
    camera = TiltShift.focused_on(lens, POINTS, shift=(2.0, -3.0))
    normal = np.cross(POINTS[1] - POINTS[0], POINTS[2] - POINTS[0])
    for xy in ((0.0, 0.0), (9.0, -4.0), (-6.0, 8.0)):
        rays = camera.sample_rays(np.tile(xy, (64, 1)), UV)
        origin = np.column_stack([rays.origin, np.zeros(64)])
        direction = np.column_stack([rays.slope, np.ones(64)])
        depth = ((POINTS[0] - origin) @ normal) / (direction @ normal)
        met = origin + depth[:, None] * direction
        assert_allclose(met, np.tile(met[0], (64, 1)), atol=1e-6)


def test_scheimpflug_sensor_lens_and_focal_plane_meet_in_one_line():
    """Scheimpflug, British patent 1196, 1904."""
    camera = TiltShift.focused_on(THIN, POINTS)
    normal = np.cross(POINTS[1] - POINTS[0], POINTS[2] - POINTS[0])
    # Focal plane and lens plane z = 0 meet where n_x x + n_y y = n . p.
    line = np.append(normal[:2], normal @ POINTS[0])
    # Sensor points lie at z = -(sensor distance + behind); their plane, by three of them, meets z = 0 in:
    corners = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    xy, behind = camera.place(corners)
    sensor = np.column_stack([xy, -(THIN.sensor_distance + behind)])
    across = np.cross(sensor[1] - sensor[0], sensor[2] - sensor[0])
    other = np.append(across[:2], across @ sensor[0])
    assert_allclose(np.cross(line / np.linalg.norm(line), other / np.linalg.norm(other)), 0, atol=1e-9)


def test_the_hinge_rule_gives_the_tilt():
    """Merklinger, "Focusing the view camera", 1996.

    The plane through the lens centre parallel to the sensor meets the focal plane f / sin(tilt) away from it.
    """
    tilt = math.radians(6.0)
    camera = TiltShift(lens=THIN, tilt=(6.0, 0.0))
    sharp = []
    for y in (-10.0, 10.0):
        rays = camera.sample_rays(np.tile([0.0, y], (2, 1)), np.array([[0.0, -1.0], [0.0, 1.0]]))
        depth = -np.diff(rays.origin[:, 1]) / np.diff(rays.slope[:, 1])
        sharp.append(np.append(rays.origin[0, 1] + depth * rays.slope[0, 1], depth))
    # The sensor leans back at its lower side, so its plane through the lens runs up into the scene.
    hinge = 50.0 / math.sin(tilt) * np.array([-math.cos(tilt), math.sin(tilt)])
    (along_y, along_z), (to_y, to_z) = sharp[1] - sharp[0], hinge - sharp[0]
    assert along_y * to_z == pytest.approx(along_z * to_y, rel=1e-9)


def test_a_shift_moves_the_picture_by_itself():
    shifted = TiltShift(lens=THIN, shift=(4.0, -2.0))
    a = THIN.sample_rays(np.array([7.0, 1.0]), np.array([0.3, 0.1]))
    b = shifted.sample_rays(np.array([3.0, 3.0]), np.array([0.3, 0.1]))
    assert_allclose(b.slope, a.slope)


def test_the_sensor_stays_flat_and_keeps_its_lengths():
    camera = TiltShift(lens=THIN, tilt=(12.0, -20.0))
    grid = np.stack(np.meshgrid([-5.0, 0.0, 5.0], [-5.0, 5.0]), -1).reshape(-1, 2)
    place = np.column_stack(camera.place(grid))
    lengths = np.linalg.norm(place[:, None] - place, axis=-1)
    assert_allclose(lengths, np.linalg.norm(grid[:, None] - grid, axis=-1), atol=1e-12)


def test_real_glass_is_sharp_in_the_tilted_plane():
    """Spots of the tilted Double Gauss at f/11 on the plane, against those of the untilted one there."""
    lens = load_lens("double_gauss", focal_length=50.0, f_number=11.0, focus_distance=1000.0)
    camera = TiltShift.focused_on(lens, POINTS)
    for point in POINTS[1:]:
        xy, behind = lens.image_of(point)
        sensor = np.column_stack(camera.place(np.eye(2)))[:, :2] - camera.place(np.zeros(2))[0]
        on_sensor = np.linalg.solve(sensor.T, xy - camera.place(np.zeros(2))[0])
        sharp = camera.sample_rays(np.tile(on_sensor, (64, 1)), UV)
        blurred = lens.sample_rays(np.tile(xy, (64, 1)), UV)
        sizes = []
        for rays in (sharp, blurred):
            met = (rays.origin + point[2] * rays.slope)[rays.weight > 0]
            sizes.append(np.linalg.norm(met - met.mean(axis=0), axis=-1).max() / point[2])
        assert abs(behind) > 0.5
        assert sizes[0] < 0.25 * sizes[1]


def test_tensors_work_and_have_gradients():
    camera = TiltShift(lens=THICK, tilt=(5.0, -3.0), shift=(1.0, 2.0))
    xy = torch.tensor([[3.0, -2.0], [0.0, 0.0]], dtype=torch.float64, requires_grad=True)
    uv = torch.tensor([[0.1, 0.5], [-0.3, 0.2]], dtype=torch.float64, requires_grad=True)
    expected = camera.sample_rays(xy.detach().numpy(), uv.detach().numpy())
    assert_allclose(camera.sample_rays(xy, uv).slope.detach().numpy(), expected.slope)
    assert torch.autograd.gradcheck(lambda a, b: camera.sample_rays(a, b).slope, (xy, uv))


def test_points_on_a_line_and_steep_tilts_are_refused():
    with pytest.raises(LensError, match="three points off one line"):
        TiltShift.focused_on(THIN, np.array([[0.0, 0.0, 800.0], [1.0, 0.0, 900.0], [2.0, 0.0, 1000.0]]))
    with pytest.raises(LensError, match="tilts up to 80"):
        TiltShift(lens=THIN, tilt=(85.0, 0.0))

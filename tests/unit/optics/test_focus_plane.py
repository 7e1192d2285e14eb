"""Leaning planes of focus, against planes and rays in space."""

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import LensError, ParameterError, ShapeError
from bokehnet.lenses import ThinLens, TiltShift
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.optics.focus_plane import (
    FocusPlane,
    distance_to_sensor,
    plane_aberration_map,
    plane_defocus,
    relative_plane,
    tilted_aberration_map,
    tilted_lens,
)

PLANE = FocusPlane(level=0.3, slope=(0.002, -0.001))
TILTS = [(8.0, 0.0), (-8.0, 0.0), (0.0, 8.0), (0.0, -8.0), (5.0, -12.0)]
LENS = {"focal_length": 50.0, "pixel_pitch": 0.05, "centre": (359.5, 239.5)}


def test_defocus_is_the_distance_from_the_plane_at_every_pixel():
    """Authority: the formula, pixel by pixel, for a map whose first value is the pixel (-3, 5)."""
    disparity = np.random.default_rng(0).random((7, 9))
    result = plane_defocus(disparity, 20.0, PLANE, (-3, 5))
    for row in range(7):
        for column in range(9):
            focus = 0.3 + 0.002 * (column - 3) - 0.001 * (row + 5)
            assert result[row, column] == pytest.approx(20 * (disparity[row, column] - focus))


def test_a_plane_without_tilt_is_a_single_disparity_bit_for_bit():
    disparity = np.random.default_rng(0).random((7, 9), dtype=np.float32)
    result = plane_defocus(disparity, 20.0, FocusPlane(level=0.3))
    assert result.dtype == np.float32
    assert_array_equal(result, defocus_from_disparity(disparity, 20.0, 0.3))


def test_tensors_give_the_same_and_have_gradients():
    disparity = np.random.default_rng(0).random((4, 5))
    tensor = torch.tensor(disparity, requires_grad=True)
    result = plane_defocus(tensor, 20.0, PLANE, (2, 1))
    assert_allclose(result.detach().numpy(), plane_defocus(disparity, 20.0, PLANE, (2, 1)), rtol=1e-12)
    assert torch.autograd.gradcheck(lambda x: plane_defocus(x, 20.0, PLANE), (tensor,))


def test_a_plane_goes_through_its_three_pixels_and_is_where_a_plane_of_the_scene_is():
    """Authority: a plane in space seen by a pinhole, slopes of directions 0.001 per pixel."""
    normal, offset = np.array([0.2, -0.5, 0.8]), 1500.0

    def disparity(x, y):  # 1 / z of the point on the plane that the pixel sees
        return (normal @ [0.001 * x - 0.3, 0.001 * y - 0.2, 1.0]) / offset

    pixels = np.array([[10, 20], [500, 60], [200, 350]])
    plane = FocusPlane.through(pixels, [disparity(*pixel) for pixel in pixels])
    for x, y in [*pixels, (0, 0), (639, 479)]:
        assert plane.at(x, y) == pytest.approx(disparity(x, y), rel=1e-12)


@pytest.mark.parametrize(
    "pixels",
    [[(1, 1), (1, 1), (5, 9)], [(0, 0), (100, 50), (200, 100)], [(0, 0), (9, 0), (5, 0)], 3 * [(2, 3)]],
)
def test_three_pixels_on_one_line_are_refused(pixels):
    with pytest.raises(ParameterError, match=r"pixels: expected three pixels off one line, .*got "):
        FocusPlane.through(pixels, [0.1, 0.2, 0.3])


def space_arrival(place, disparity, pupil, slopes, level, focal_scale, radius):
    """Pixel where the ray of a scene point through a point of the pupil arrives, by rays in space.

    The point is seen at ``place`` from the middle of the pupil. Where its ray meets the plane of focus
    ``1 / z = level + slopes . (x, y) / z``, all rays of one pixel meet; it is seen at that pixel.
    Light of a point in front of focus arrives on the side of its own a, hence the pupil point -radius a.
    """
    point = np.append(place / focal_scale, 1.0) / disparity
    through = np.append(-radius * pupil, 0.0)
    normal = np.array([*slopes, level])  # normal . X = 1 on the plane
    step = (1 - normal @ through) / (normal @ (point - through))
    met = through + step * (point - through)
    return met[:2] / met[2] * focal_scale


def test_light_arrives_where_rays_in_space_say():
    """The conic: oracle ``space_arrival``, at random points, pupil points, and both signs of the slopes."""
    rng = np.random.default_rng(1)
    focal_scale, radius = 1000.0, 25.0  # pixels per unit slope, mm
    blur = focal_scale * radius
    largest = 0.0
    for _ in range(200):
        slopes, level = rng.uniform(-0.02, 0.02, 2), 0.001
        plane = FocusPlane(level=level, slope=tuple(slopes / focal_scale))
        place, pupil = rng.uniform(-300, 300, 2), rng.uniform(-0.7, 0.7, 2)
        disparity = rng.uniform(0.0005, 0.002)
        expected = space_arrival(place, disparity, pupil, slopes, level, focal_scale, radius)
        defocus = blur * (disparity - plane.at(*place))
        _, run, _ = plane_aberration_map(plane, blur)(pupil, np.zeros(2))
        assert_allclose(place + defocus * run, expected, rtol=1e-9, atol=1e-9)
        # The other way: from the pixel that receives it, the ray of this pupil point runs over the place.
        assert_allclose(expected - defocus * run, place, rtol=1e-9, atol=1e-9)
        largest = max(largest, abs(1 - np.linalg.norm(run) / np.linalg.norm(pupil)))
    assert largest > 0.3  # so that a circle would have failed


@pytest.mark.parametrize("tilt", [*TILTS, (-20.0, 15.0), (30.0, 0.0)])
def test_light_of_a_tilted_lens_arrives_where_its_rays_do(tilt):
    """Authority: the rays of :class:`TiltShift`, met by planes parallel to its sensor."""
    rng = np.random.default_rng(2)
    pitch, centre, size = LENS["pixel_pitch"], np.array(LENS["centre"]), (720, 480)
    lens = ThinLens(focal_length=LENS["focal_length"], f_number=1.4)
    plane, distance = tilted_lens(tilt, LENS["centre"], 1 / 1500, **LENS)
    blur = lens.pupil_radius * distance / pitch
    aberrations = tilted_aberration_map(
        plane, blur, focal_length=lens.focal_length, pixel_pitch=pitch, distance=distance, size=size
    )
    upright = TiltShift(lens=lens, tilt=tilt).place(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    points = np.column_stack([upright[0], -upright[1]])
    right, down = points[1:] - points[0]
    axes = np.stack([right, down, np.cross(right, down)])
    x, y, z = -distance * axes[2]
    sensor = TiltShift(lens=lens, tilt=tilt, shift=(x, y), offset=-z - lens.sensor_distance)
    half_diagonal, apart = 0.5 * math.hypot(*size), 0.0
    for _ in range(100):
        pixel, pupil = rng.uniform((0, 0), size), rng.uniform(-0.7, 0.7, 2)
        disparity = rng.uniform(0.0003, 0.0015)
        sent = sensor.sample_rays((centre - pixel)[None] * pitch, -pupil[None])
        origin, slope = np.append(sent.origin[0], 0.0), np.append(sent.slope[0], 1.0)
        met = axes @ (origin + (1 / disparity - axes[2] @ origin) / (axes[2] @ slope) * slope)
        place = met[:2] / met[2] * distance / pitch + centre
        defocus = blur * (disparity - plane.at(*place))
        _, run, _ = aberrations(pupil, (pixel - centre) / half_diagonal)
        assert_allclose(pixel - defocus * run, place, atol=1e-9 * blur)
        apart = max(apart, np.abs(run - plane_aberration_map(plane, blur)(pupil, np.zeros(2))[1]).max())
    assert apart > 0.02  # so that an upright aperture would have failed


def test_a_plane_without_tilt_bends_no_ray():
    assert plane_aberration_map(FocusPlane(level=0.3), 50.0).is_perfect
    assert not plane_aberration_map(PLANE, 50.0).is_perfect


@pytest.mark.parametrize(
    ("tilt", "first", "last"),
    [((45, 0), (1.0, 0.5), (0.0, 0.5)), ((-45, 0), (0, 0.5), (1, 0.5)), ((0, 45), (0.5, 0), (0.5, 1))],
)
def test_45_degrees_lead_through_all_relative_disparity(tilt, first, last):
    """Focus in the middle of the upper and of the left side, and of the lower and of the right side."""
    plane = relative_plane(tilt, (299.5, 199.5), 0.5, (600, 400))
    assert (plane.at(299.5, -0.5), plane.at(-0.5, 199.5)) == pytest.approx(first, abs=1e-12)
    assert (plane.at(299.5, 399.5), plane.at(599.5, 199.5)) == pytest.approx(last, abs=1e-12)


def test_a_lens_that_is_not_tilted_is_the_thin_lens():
    plane, distance = tilted_lens((0.0, 0.0), (7.0, 9.0), 1 / 1200, **LENS)
    expected = ThinLens(focal_length=50.0, f_number=2.0, focus_distance=1200.0).sensor_distance
    assert (distance, plane.level, *plane.slope) == pytest.approx((expected, 1 / 1200, 0, 0))


@pytest.mark.parametrize("tilt", TILTS)
@pytest.mark.parametrize("pixel", [LENS["centre"], (20.0, 400.0)])
def test_the_hinge_rule_and_the_focus(tilt, pixel):
    """Merklinger, "Focusing the view camera", 1996: the plane is f / sin(tilt) from the lens beside it."""
    plane, distance = tilted_lens(tilt, pixel, 1 / 1200, **LENS)
    assert plane.at(*pixel) == pytest.approx(1 / 1200)
    across, down = (math.radians(angle) for angle in tilt)
    angle = math.acos(math.cos(across) * math.cos(down))
    # In space the plane is 1 = level z + slope . (x, y), slope per unit of x / z; 1 / slope away at z = 0.
    per_slope = math.hypot(*plane.slope) * distance / 0.05
    assert 1 / per_slope == pytest.approx(50 / math.sin(angle))


def test_the_conic_of_a_tilted_lens_is_half_the_sine_over_the_f_number():
    """Authority: blur * slope = R d / pitch * sin(tilt) pitch / (f d) = sin(tilt) / (2 N)."""
    plane, distance = tilted_lens((0.0, 20.0), LENS["centre"], 1 / 700, **LENS)
    blur = 50 / 1.4 / 2 * distance / 0.05
    assert plane_aberration_map(plane, blur).tilt == pytest.approx((math.sin(math.radians(20)) / 2.8, 0))


@pytest.mark.parametrize("tilt", [(0.0, 0.0), *TILTS, (-30.0, 10.0)])
@pytest.mark.parametrize("disparity", [0.0, 1 / 5000, 1 / 300])
def test_the_sensor_of_a_plane_is_that_of_the_tilt_that_made_it(tilt, disparity):
    """Oracle: ``tilted_lens``, whose planes are checked against a traced sensor in tests/reference."""
    plane, distance = tilted_lens(tilt, (100.0, 300.0), disparity, **LENS)
    assert distance_to_sensor(plane, **LENS) == pytest.approx(distance, rel=1e-9)


def test_planes_and_distances_that_no_lens_can_do_are_refused():
    near = FocusPlane.around(
        LENS["centre"], 1 / 1000, (0.05 / 50 / 40, 0.0)
    )  # passes 40 mm beside 50 mm of f
    with pytest.raises(
        LensError, match=r"focus plane: no tilt of a lens of 50 mm .*at 1000 mm in the middle"
    ):
        distance_to_sensor(near, **LENS)
    with pytest.raises(LensError, match=r"focus plane: no tilt .*at 49 mm"):
        distance_to_sensor(FocusPlane(level=1 / 49), **LENS)
    with pytest.raises(LensError, match=r"tilted lens: cannot focus at 49 mm: need more than 50.19 mm"):
        tilted_lens((5.0, 0.0), LENS["centre"], 1 / 49, **LENS)


@pytest.mark.parametrize(("tilt", "name"), [((81.0, 0.0), "tilt_x"), ((0.0, -90.0), "tilt_y")])
def test_steep_tilts_are_refused(tilt, name):
    with pytest.raises(ParameterError, match=f"{name}: expected up to 80 degrees"):
        relative_plane(tilt, (0, 0), 0.5, (10, 10))
    with pytest.raises(ParameterError, match=name):
        tilted_lens(tilt, (0, 0), 0.001, **LENS)


def test_an_invalid_map_is_refused():
    with pytest.raises(ShapeError, match="disparity"):
        plane_defocus(np.zeros(5), 1.0, PLANE)

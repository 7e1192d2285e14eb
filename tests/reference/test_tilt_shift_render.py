"""The leaning plane of focus of ``bokehnet render`` against the ray tracer's tilted sensor."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter, map_coordinates

from benchmarks.experiments.lenses.tilt_shift import (
    TILTS,
    best_focus,
    focus_of,
    focused_lens,
    sensor_axes,
    tilted_camera,
    trace_wall,
    zero_line,
)
from bokehnet.classical.rays_renderer import rays
from bokehnet.lenses import ThinLens, TiltShift
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.focus_plane import (
    FocusPlane,
    distance_to_sensor,
    plane_aberration_map,
    plane_defocus,
    tilted_lens,
)
from bokehnet.optics.sampling import disc_from_square, halton
from bokehnet.raytrace import Camera

WIDTH, HEIGHT = 192, 144
CENTRE = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
PIXELS = np.array([CENTRE, (0, 0), (WIDTH - 1, 20), (40, HEIGHT - 1), (150, 100)])


def seen_from(camera, pixels, pupil, depth=None):
    """Return the positions in the picture of rays of pixels (N, 2) by pupil points (N, 2), and 1 / depth.

    Traced: the sensor is tilted in the axes of the lens; all values are in those of the sensor. At ``depth``
    along its normal, mm; by default where the ray meets that of the middle of the pupil.
    """
    lens, pitch = camera.lens, camera.pixel_pitch
    axes = sensor_axes(lens)
    sensor_xy = -pitch * (pixels - CENTRE)
    bundle = lens.sample_rays(sensor_xy, pupil)
    origin = np.column_stack([bundle.origin, np.zeros(len(pixels))]) @ axes.T
    direction = np.column_stack([bundle.slope, np.ones(len(pixels))]) @ axes.T
    if depth is None:
        chief = np.column_stack([lens.sample_rays(sensor_xy, 0 * pupil).slope, np.ones(len(pixels))]) @ axes.T
        # origin + s direction = c chief
        pairs = np.stack([-direction, chief], -1)
        solved = [np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(pairs, origin, strict=True)]
        met = np.array(solved)[:, 1:] * chief
    else:
        met = origin + ((depth - origin[:, 2]) / direction[:, 2])[:, None] * direction
    to_sensor = -axes[2] @ [*lens.shift, -(lens.lens.sensor_distance + lens.offset)]
    return met[:, :2] / met[:, 2:] * to_sensor / pitch + CENTRE, 1 / met[:, 2]


@pytest.mark.parametrize("tilt", TILTS)
def test_the_plane_in_focus_is_that_of_traced_rays(tilt):
    """All rays of a pixel meet at 1 / depth = focus there, for both signs about x and about y."""
    camera = tilted_camera(tilt, WIDTH, HEIGHT)
    plane, distance = tilted_lens(
        tilt,
        CENTRE,
        1 / focus_of(camera),
        focal_length=50.0,
        pixel_pitch=camera.pixel_pitch,
        centre=CENTRE,
    )
    for pupil in ((0.6, 0.2), (-0.1, -0.8)):
        place, disparity = seen_from(camera, PIXELS, np.tile(pupil, (len(PIXELS), 1)))
        assert_allclose(place, PIXELS, atol=1e-6)
        assert_allclose(disparity, plane.at(PIXELS[:, 0], PIXELS[:, 1]), rtol=1e-9)
    assert distance == pytest.approx(56.0)
    again = distance_to_sensor(
        FocusPlane.through(PIXELS[1:4], disparity[1:4]),
        focal_length=50.0,
        pixel_pitch=camera.pixel_pitch,
        centre=CENTRE,
    )
    assert again == pytest.approx(56.0)


def test_three_pixels_determine_the_plane_on_any_tilted_and_shifted_sensor():
    """Authority: intersections of traced rays, at three pixels and at others; the lens is off the middle."""
    lens = TiltShift(
        lens=ThinLens(focal_length=50.0, f_number=2.0, focus_distance=900.0),
        tilt=(-11.0, 4.0),
        shift=(3.0, -5.0),
        offset=0.7,
    )
    camera = Camera(lens=lens, width=WIDTH, height=HEIGHT, pixel_pitch=0.1)
    _, disparity = seen_from(camera, PIXELS, np.tile((0.4, 0.5), (len(PIXELS), 1)))
    plane = FocusPlane.through(PIXELS[:3], disparity[:3])
    assert_allclose(plane.at(PIXELS[:, 0], PIXELS[:, 1]), disparity, rtol=1e-8)
    assert np.ptp(disparity) > 1e-4


@pytest.mark.parametrize("tilt", [*TILTS, (30.0, 0.0), (0.0, -30.0)])
def test_discs_are_the_cones_of_traced_rays(tilt):
    """Light of a point arrives at ``q + d A``: traced, A is the aberration map's.

    The aperture stands upright in the lens, tilted against the sensor: seen from the pixel p its point
    (x, y, z), in the sensor's axes, is at (x, y) - z t with t the slope of p.
    """
    camera = tilted_camera(tilt, WIDTH, HEIGHT)
    lens, pitch = camera.lens, camera.pixel_pitch
    radius = lens.lens.pupil_radius
    plane, distance = tilted_lens(
        tilt, CENTRE, 1 / focus_of(camera), focal_length=50.0, pixel_pitch=pitch, centre=CENTRE
    )
    blur = radius * distance / pitch
    aberration_map = plane_aberration_map(plane, blur)
    slopes = (PIXELS - CENTRE) * pitch / distance
    axes = sensor_axes(lens)
    strongest = 0.0
    for depth in (350.0, 900.0):
        for a in ((0.8, 0.3), (-0.9, 0.1), (0.2, -0.9), (-0.3, 0.6)):
            # A point in front of focus lights the side of a: it is the pupil point -radius a.
            place, disparity = seen_from(camera, PIXELS, np.tile(np.negative(a), (len(PIXELS), 1)), depth)
            through = np.array([*a, 0.0]) @ axes.T  # the pupil point over -radius
            seen = (through[:2] - through[2] * slopes) / (
                1 + radius * through[2] * plane.at(*PIXELS.T)[:, None]
            )
            defocus = blur * (disparity - plane.at(place[:, 0], place[:, 1]))
            run = seen / (1 + seen @ aberration_map.tilt)[:, None]
            assert_allclose(place + defocus[:, None] * run, PIXELS, atol=1e-6)
            # The map itself takes the aperture as parallel to the sensor, which is off by so much:
            selected = aberration_map(np.tile(a, (len(PIXELS), 1)), np.zeros_like(PIXELS))[1]
            angle = math.acos(axes[2, 2])
            allowed = 1 - math.cos(angle) + math.sin(angle) * (np.abs(slopes).max() + radius / 350)
            assert np.linalg.norm(selected - run, axis=-1).max() <= 1.5 * allowed
            strongest = max(strongest, np.linalg.norm(run - seen, axis=-1).max())
    assert strongest > 0.05


def defocus_behind(camera, tilt, depth):
    lens, disparity = focused_lens(camera, tilt, depth)
    return lens.defocus(disparity)


@pytest.mark.parametrize("tilt", [TILTS[1], TILTS[2], TILTS[4]])
def test_the_line_of_best_focus_is_within_two_pixels(tilt):
    """Traced wall of noise, measured by its sharpness, against where the defocus of the options is 0."""
    camera = tilted_camera(tilt, WIDTH, HEIGHT)
    bokeh, sharp, depth = trace_wall(camera, 48)
    defocus = defocus_behind(camera, tilt, depth)
    without, reversed_tilt = (0.0, 0.0), (-tilt[0], -tilt[1])
    others = [defocus_behind(camera, wrong, depth) for wrong in (without, reversed_tilt)]
    if abs(tilt[1]) > abs(tilt[0]):
        bokeh, sharp, defocus, *others = (np.swapaxes(x, 0, 1) for x in (bokeh, sharp, defocus, *others))
    columns, rows = best_focus(bokeh, sharp, 5)
    assert np.abs(rows - zero_line(defocus, columns)).max() < 2
    for other in others:
        assert np.abs(rows - zero_line(other, columns)).max() > 6


@pytest.mark.parametrize("slope", [(0.0075, 0.0), (-0.0075, 0.0), (0.0, 0.01)])
def test_rays_follow_the_cones(slope):
    """A wall of one disparity: oracle is the integral over the pupil of what each pixel's rays run over."""
    blur, pixel = 40.0, (80, 60)
    rng = np.random.default_rng(0)
    image = gaussian_filter(rng.random((120, 160, 3)), (1.5, 1.5, 0))
    image = (((image - image.min()) / np.ptp(image)) ** 2).astype(np.float32)
    plane = FocusPlane.around(pixel, 0.5, slope)
    defocus = plane_defocus(np.full((120, 160), 0.7, np.float32), blur, plane)
    y, x = np.mgrid[:120, :160].astype(float)
    radius = blur * (0.7 - plane.at(x, y))
    expected = np.zeros((120, 160, 3))
    pupil = disc_from_square(np.stack([halton(512, 2), halton(512, 3)], -1))
    for u, v in pupil:
        for channel in range(3):
            places = y - radius * v, x - radius * u
            expected[..., channel] += map_coordinates(image[..., channel], places, order=1, mode="nearest")
    expected /= len(pupil)
    aberration_map = plane_aberration_map(plane, blur)
    inside = slice(25, -25)
    error = {}
    for name, lens_response in (("conic", LensResponse(aberration_map=aberration_map)), ("round", None)):
        picture = rays(image, defocus, lens_response=lens_response)
        error[name] = float(((picture - expected)[inside, inside] ** 2).mean()) ** 0.5
    assert error["conic"] < 0.005
    assert error["conic"] < 0.5 * error["round"]

"""Aberration maps against the rays through the glass that they stand for."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.errors import LensError
from bokehnet.lenses import Rays, catalog_names, load_lens
from bokehnet.lenses.aberrations.aberration_fit import aberration_misfit, fit_aberration_map
from bokehnet.lenses.stop_rays import stop_rays
from bokehnet.optics.sampling import disc_from_square, halton

PIXELS = 1000  # of a half diagonal
SQUARE = np.stack([halton(8000, base) for base in (2, 3, 5, 7)], -1)
DISC, OTHER_DISC = disc_from_square(SQUARE[:, :2]), disc_from_square(SQUARE[:, 2:])


@cache
def wide_open(name):
    """Lens of the catalog, focused at 30 focal lengths."""
    return load_lens(name, focus_distance=30 * load_lens(name).focal_length)


@cache
def map_of(name, distortion=False):
    """Fitted map of a lens wide open; each takes seconds, and many tests share it."""
    return fit_aberration_map(wide_open(name), distortion=distortion)


def pupil_of(full, lens, origin, field):
    """Coordinates a of rays that cross the entrance pupil at ``origin``: A(a) = -origin / radius."""
    expected = -origin / lens.thick.pupil_radius
    pupil = np.array(expected)
    for _ in range(40):
        pupil = pupil + expected - full(pupil, field)[1]
    return pupil


@pytest.mark.slow
@pytest.mark.parametrize("name", catalog_names())
def test_rays_are_those_through_the_glass(name):
    """Reference: traced rays of random fields; 546 and 450 nm lie between the wavelengths of the fit."""
    for distortion in (False, True):
        for wavelength, largest in ((None, 0.04), (400.0, 0.04), (546.07, 0.15), (450.0, 0.15)):
            transverse_aberration, pupil_aberration = aberration_misfit(
                wide_open(name), map_of(name, distortion), distortion=distortion, wavelength=wavelength
            )
            assert PIXELS * transverse_aberration < largest
            assert pupil_aberration < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cooke_triplet", "double_gauss", "retrofocus"])
@pytest.mark.parametrize("share", [0.6, 1.7])
def test_light_of_a_point_arrives_at_the_position_of_the_map(name, share):
    """Reference: light sent from the scene to the sensor, and where a pinhole camera sees the point."""
    lens, full = wide_open(name), map_of(name, distortion=True)
    half_diagonal, depth = lens.prescription.image_radius, share * lens.focus_distance
    seen = 0.5 * np.array([0.8, -0.6])
    slope = seen * half_diagonal / lens.sensor_distance
    origin = 1.5 * lens.thick.pupil_radius * DISC
    reached, passes = lens.trace_to_sensor(Rays(origin=origin, slope=slope - origin / depth))
    field = (-reached / half_diagonal)[passes]
    assert passes.sum() > 500
    pupil = pupil_of(full, lens, origin[passes], field)
    transverse_aberration, bent, inside = full(pupil, field)
    defocus = float(lens.coc_radius(1 / depth)) / half_diagonal
    assert_allclose(
        field - defocus * bent - transverse_aberration, np.broadcast_to(seen, field.shape), atol=3e-4
    )
    assert ((pupil**2).sum(-1) < 1.01**2).mean() > 0.999
    assert inside.mean() > 0.97


def rays_to_the_stop(lens, distance):
    """Rays evenly over a disc that is larger than the pupil, their light, and which pass the stop."""
    place = lens.prescription.image_radius * np.tile([distance, 0.0], (len(DISC), 1))
    rays = stop_rays(lens, place, 1.7 * abs(lens.paraxial.exit.radius) * DISC)
    stop = next(i for i, row in enumerate(lens.prescription.surfaces) if row.stop)
    goes_on = (rays.heights.max(axis=0) < 1e5) & (rays.heights[stop] <= 1)
    return rays, rays.sensor_slope[2] ** 4, goes_on


@pytest.mark.slow
@pytest.mark.parametrize("name", catalog_names())
@pytest.mark.parametrize("distance", [0.0, 0.4, 0.7, 0.95])
def test_rims_pass_the_share_of_light_that_the_glass_passes(name, distance):
    """Reference: traced rays, weighted by the cosines at the sensor; of the light through the stop."""
    lens, aberration_map = wide_open(name), map_of(name)
    rays, light, goes_on = rays_to_the_stop(lens, distance)
    value = aberration_map(OTHER_DISC, np.broadcast_to([distance, 0.0], OTHER_DISC.shape))[2].mean()
    assert value == pytest.approx((light * rays.passes).sum() / (light * goes_on).sum(), abs=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["double_gauss", "telephoto", "retrofocus"])
@pytest.mark.parametrize("distance", [0.0, 0.6])
def test_aperture_coordinates_are_evenly_lit(name, distance):
    """Reference: radiometry; light goes with the area in cosines at the sensor. Places in the stop fail."""
    lens, full = wide_open(name), map_of(name, distortion=True)
    rays, light, _ = rays_to_the_stop(lens, distance)
    field = np.broadcast_to([distance, 0.0], DISC.shape)
    passes = rays.passes
    pupil = pupil_of(full, lens, rays.origin[passes], field[passes])
    even = OTHER_DISC[full(OTHER_DISC, field)[2]]
    worst = []
    for coordinates in (pupil, rays.stop[passes]):
        inside = full(coordinates, field[passes])[2]
        parts = [
            (light[passes][inside] * part(coordinates[inside])).sum() / light[passes][inside].sum()
            - part(even).mean()
            for part in (lambda a: a[:, 0] > 0, lambda a: (a**2).sum(-1) < 0.25, lambda a: a[:, 1] > 0.4)
        ]
        worst.append(np.abs(parts).max())
    assert worst[0] < 0.005
    assert worst[0] < worst[1] / 4


def test_a_lens_stopped_far_down_is_nearly_perfect():
    """Reference: Gauss. Near the axis of a narrow pencil all coordinates are those of a perfect lens."""
    lens = load_lens("double_gauss", f_number=45.0, focus_distance=3000.0)
    aberration_map = fit_aberration_map(lens, half_diagonal=4.0, wavelengths=())
    transverse_aberration, bent, passes = aberration_map(DISC, 0.5 * OTHER_DISC)
    assert passes.all()
    assert np.abs(transverse_aberration).max() < 1e-4
    assert np.abs(bent - DISC).max() < 1e-2
    assert not aberration_map.is_dispersive


def test_a_smaller_picture_is_the_middle_of_a_larger_one():
    """Half of the field in half of the picture: misses in mm and coordinates are the same."""
    lens = load_lens("petzval", focus_distance=3000.0)
    whole, half = (fit_aberration_map(lens, half_diagonal=size, wavelengths=()) for size in (12.0, 6.0))
    field = 0.9 * OTHER_DISC
    for one, other, factor in zip(
        whole(0.9 * DISC, 0.5 * field), half(0.9 * DISC, field), (2, 1), strict=False
    ):
        assert_allclose(factor * one, other, atol=1e-3 if factor == 1 else 2e-5)


def test_a_picture_beyond_the_light_of_the_lens_is_refused():
    with pytest.raises(LensError, match=r"Petzval: half diagonal: .* to 18 mm.*got 40"):
        fit_aberration_map(load_lens("petzval"), half_diagonal=40.0)


def test_a_lens_whose_rays_miss_its_glass_is_one_line(tmp_path):
    """A radius of 5 mm behind a stop of 15.9 mm: nearly no ray meets the surface."""
    text = (
        "MODE SEQ\nNAME T\nUNIT MM\nENPD 15.9\nYFLN 5\nWAVM 1 0.5875618 1\n"
        "SURF 0\n CURV 0\n DISZ INFINITY\n"
        "SURF 1\n STOP\n CURV 0.2\n DISZ 4\n GLAS N-BK7 0 0 1.5168 64.17\n DIAM 9\n"
        "SURF 2\n CURV -0.01\n DISZ 60\n DIAM 9\nSURF 3\n CURV 0\n DISZ 0\n"
    )
    path = tmp_path / "ball.zmx"
    path.write_text(text)
    lens = load_lens(str(path))
    with pytest.raises(LensError, match="miss a surface"):
        fit_aberration_map(lens)

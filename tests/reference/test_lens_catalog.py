"""The catalog against what was published, and rays against Gaussian optics."""

import numpy as np
import pytest

from bokehnet.lenses import Rays, catalog_names, depth_of_field, load_lens
from bokehnet.lenses.pupils.paraxial_lens import paraxial_lens, traced_focal_length, traced_pupils
from bokehnet.lenses.reports.plot import spot
from bokehnet.optics.spectral.glass import C_LINE, D_LINE, F_LINE

ANGLES = np.linspace(0, 2 * np.pi, 64, endpoint=False)
RIM = np.stack([np.cos(ANGLES), np.sin(ANGLES)], -1)


@pytest.mark.parametrize("name", catalog_names(mirrors=False))
def test_focal_length_by_matrix_by_rays_and_as_published(name):
    """Rays parallel to the axis within 0.2 %; the published value within 1 %."""
    lens = load_lens(name)
    for zone in (0.02, 0.1):
        height = zone * abs(lens.paraxial.entrance.radius)
        assert traced_focal_length(lens.surfaces, height) == pytest.approx(lens.focal_length, rel=2e-3)
    assert lens.focal_length == pytest.approx(lens.prescription.focal_length, rel=0.01)


@pytest.mark.parametrize("name", catalog_names(mirrors=False))
def test_f_number_is_the_published_one(name):
    """Within 6 %: where the patent gives no clear apertures, ours serve the published cone of real rays."""
    lens = load_lens(name)
    assert lens.min_f_number == pytest.approx(lens.prescription.f_number, rel=0.06)


@pytest.mark.parametrize("name", catalog_names(mirrors=False))
def test_pupils_by_rays_and_by_imaging_agree(name):
    """Position and radius within 0.5 %, for the zone where Gaussian optics holds."""
    lens = load_lens(name)
    for traced, imaged in zip(
        traced_pupils(lens.surfaces, zone=0.2), (lens.paraxial.entrance, lens.paraxial.exit), strict=True
    ):
        assert traced.position == pytest.approx(imaged.position, abs=0.005 * lens.focal_length)
        assert traced.radius == pytest.approx(imaged.radius, rel=0.005)


def test_retrofocus_and_telephoto_are_what_they_are_called():
    """Back focus longer than the focal length; length from first surface to image shorter than it."""
    retrofocus, telephoto = load_lens("retrofocus"), load_lens("telephoto")
    back = retrofocus.paraxial.cardinal.rear_focus - retrofocus.paraxial.length
    assert back > 1.3 * retrofocus.focal_length
    assert telephoto.paraxial.cardinal.rear_focus < telephoto.focal_length


@pytest.mark.parametrize("name", catalog_names(mirrors=False))
def test_spots_are_those_of_a_working_lens(name):
    """At f/8 and 0.7 of the field; a wrong digit in the table makes them many times as large."""
    lens = load_lens(name, f_number=8.0)
    points = spot(lens, 0.7 * lens.prescription.image_radius, lens.prescription.design_wavelength)
    radius = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(1).mean())
    assert radius < (2.5e-3 if name == "biconvex" else 6e-4) * lens.focal_length


@pytest.mark.parametrize("name", catalog_names(mirrors=False))
@pytest.mark.parametrize("depth", [0.5, 2.5])
def test_traced_spot_equals_coc_radius(name, depth):
    """Light of a point on the axis, through the rim of a pinhole of f/90, where Gauss holds: 0.5 %."""
    focus = 20 * load_lens(name).focal_length
    lens = load_lens(name, f_number=90.0, focus_distance=focus)
    origin = lens.thick.pupil_radius * RIM
    xy, passes = lens.trace_to_sensor(Rays(origin=origin, slope=-origin / (depth * focus)))
    expected = abs(lens.coc_radius(1 / (depth * focus)))
    np.testing.assert_allclose(np.linalg.norm(xy, axis=-1), expected, rtol=5e-3)
    assert expected > 0.005
    assert passes.shape == (64,)


@pytest.mark.parametrize("name", ["double_gauss", "retrofocus", "telephoto"])
def test_real_rays_blur_by_the_limit_at_the_limits_of_depth_of_field(name):
    lens = load_lens(name, f_number=64.0, focus_distance=30 * load_lens(name).focal_length)
    limit = 0.02
    origin = lens.thick.pupil_radius * RIM
    for depth in depth_of_field(lens, limit):
        slope = -origin / depth if np.isfinite(depth) else 0 * origin
        xy, _ = lens.trace_to_sensor(Rays(origin=origin, slope=slope))
        if np.isfinite(depth):
            np.testing.assert_allclose(np.linalg.norm(xy, axis=-1), limit, rtol=0.03)
        else:
            assert np.linalg.norm(xy, axis=-1).max() < 1.03 * limit


@pytest.mark.parametrize("name", ["biconvex", "double_gauss"])
def test_an_array_of_wavelengths_gives_the_gaussian_optics_of_each(name):
    """Rays of that wavelength are the reference; in a singlet df / f = 1 / V between the lines F and C."""
    lens = load_lens(name)
    lines = np.array([F_LINE, D_LINE, C_LINE])
    together = paraxial_lens(lens.prescription.trace_surfaces(lines))
    lengths = together.cardinal.focal_length
    places = np.broadcast_to(together.entrance.position, 3)
    for line, length, place in zip(lines, lengths, places, strict=True):
        surfaces = lens.prescription.trace_surfaces(line)
        assert traced_focal_length(surfaces, 0.05) == pytest.approx(length, rel=1e-5)
        assert traced_pupils(surfaces, zone=0.1)[0].position == pytest.approx(place, abs=0.01)
    if name == "biconvex":
        assert (lengths[2] - lengths[0]) / lengths[1] == pytest.approx(1 / 64.17, rel=0.02)

"""Curves of a lens against third-order theory, formulas and other ways to the same number."""

import numpy as np
import pytest

from bokehnet.lenses import load_lens
from bokehnet.lenses.pupils.paraxial_lens import paraxial_lens
from bokehnet.lenses.reports.analysis import (
    airy_mtf,
    chromatic_focus,
    field_curvature,
    geometric_mtf,
    ray_fan,
    spherical_focus,
)
from bokehnet.lenses.reports.facts import distortion, lens_facts
from bokehnet.lenses.seidel_lens import reduce_lens, seidel_by_surface
from bokehnet.optics.spectral.glass import C_LINE, F_LINE


def sums(lens):
    rows = [values for _, values in seidel_by_surface(lens)]
    return {name: sum(row[name] for row in rows) for name in rows[0]}


def test_the_field_curves_as_seidels_sums_say():
    """Welford 1986, 8.5: dz of -(3 S3 + S4) / 2 and -(S3 + S4) / 2 over n u^2, at a tenth of the field."""
    for name in ("double_gauss", "telephoto", "biconvex"):
        lens = load_lens(name, f_number=16.0, focusing="paraxial")
        cone = abs(lens.paraxial.entrance.radius) / lens.focal_length
        total = sums(lens)
        tangential, sagittal = field_curvature(lens, np.array([0.1]))
        scale = -0.01 / 2 / cone**2
        assert tangential[0] == pytest.approx(scale * (3 * total["astigmatism"] + total["petzval"]), rel=0.05)
        assert sagittal[0] == pytest.approx(scale * (total["astigmatism"] + total["petzval"]), rel=0.05)


def test_zones_cross_the_axis_as_the_patent_draws_it():
    """US 2,500,046, fig. 3: -0.20 mm at a height of 18 mm; the sum of Seidel near the axis."""
    lens = load_lens("petzval")
    zone = 18.0 / abs(lens.paraxial.entrance.radius)
    assert spherical_focus(lens, np.array([zone]))[0] == pytest.approx(-0.20, abs=0.03)
    cone = abs(lens.paraxial.entrance.radius) / lens.focal_length
    third = -sums(lens)["spherical"] / 2 / cone**2 * 0.1**2
    assert spherical_focus(lens, np.array([0.1]))[0] == pytest.approx(third, rel=0.05)


def test_colours_focus_where_gaussian_optics_has_them():
    lens = load_lens("double_gauss")
    lines = np.array([F_LINE, C_LINE])
    rear = paraxial_lens(lens.prescription.trace_surfaces(lines)).cardinal.rear_focus
    expected = rear - lens.paraxial.cardinal.rear_focus
    np.testing.assert_allclose(chromatic_focus(lens, lines), expected, atol=2e-3)


def test_the_fan_of_a_singlet_is_the_cube_of_the_height():
    """Third order at f/16 on the axis, in the plane of least blur: S (a^3 - 2/3 a)."""
    lens = load_lens("biconvex", f_number=16.0)
    spherical = (
        float(reduce_lens(lens, wavelengths=[587.5618]).image.spherical[0]) * lens.prescription.image_radius
    )
    pupil, along, across = ray_fan(lens, 0.0)
    inside = np.abs(pupil) < 0.95
    expected = spherical * (pupil**3 - 2 / 3 * pupil)[inside]
    assert np.abs(np.abs(along[inside]) - np.abs(expected)).max() < 0.03 * abs(spherical)
    np.testing.assert_allclose(along, across, atol=1e-9)
    assert np.isnan(along[0])


def test_the_mtf_of_a_disc_is_that_of_bessel():
    """Goodman 2005, 6.4: a disc of radius R has 2 J1(x) / x, x = 2 pi f R; zero at x = 3.8317."""
    lens = load_lens("biconvex", f_number=60.0, focusing="paraxial")
    vars(lens)["focus_shift"] = 3.0
    radius = 3.0 / 2 / lens.thick.f_number
    radius *= lens.paraxial.exit.radius / lens.paraxial.entrance.radius
    radius *= lens.focal_length / (lens.gaussian_focus - lens.paraxial.exit.position)
    frequencies = np.array([0.0, 1.0, 3.8317 / (2 * np.pi * radius)])
    tangential, sagittal = geometric_mtf(lens, 0.0, frequencies)
    x = 2 * np.pi * radius
    bessel = 1 - x**2 / 8 + x**4 / 192 - x**6 / 9216
    np.testing.assert_allclose(tangential, [1, bessel, 0], atol=0.01)
    np.testing.assert_allclose(sagittal, [1, bessel, 0], atol=0.01)


def test_diffraction_leaves_no_lines_beyond_its_cut():
    """1 / (wavelength N): 1704 line pairs per mm at f/1 and 587 nm."""
    lens = load_lens("double_gauss", f_number=8.0)
    cut = 1e6 / 587.5618 / lens.working_f_number
    np.testing.assert_allclose(airy_mtf(lens, np.array([0.0, cut / 2, cut])), [1, 0.391, 0], atol=1e-3)


def test_distortion_near_the_axis_is_that_of_the_fifth_sum():
    """Welford 1986, 8.5: the height changes by S5 / 2 over n' u'; the retrofocus, at 0.15 of the field."""
    lens = load_lens("retrofocus", f_number=16.0, focusing="paraxial")
    cone = abs(lens.paraxial.entrance.radius) / lens.focal_length
    third = -sums(lens)["distortion"] / 2 / cone / lens.prescription.image_radius * 0.15**2
    assert abs(distortion(lens, np.array([0.15]))[0]) == pytest.approx(abs(third), rel=0.1)


def test_facts_are_json_numbers_of_the_lens():
    facts = lens_facts(load_lens("petzval", focus_distance=3000.0))
    assert facts["focal_length"] == pytest.approx(99.984, abs=1e-3)
    assert facts["working_f_number"] > facts["published_f_number"]
    assert facts["fields"][0]["relative_illumination"] == 1
    assert len(facts["seidel"]) == 7


def test_curves_near_the_axis_look_through_a_dark_middle():
    """Gaussian optics by wavelength, and Seidel's sums at a tenth of the field, of a mirror lens."""
    lens = load_lens("catadioptric")
    lines = np.array([440.0, F_LINE, C_LINE])
    rear = paraxial_lens(lens.prescription.trace_surfaces(lines)).cardinal.rear_focus
    np.testing.assert_allclose(
        chromatic_focus(lens, lines), rear - lens.paraxial.cardinal.rear_focus, atol=1e-4
    )
    assert np.isnan(spherical_focus(lens, np.array([0.02]))).all()  # nothing passes there
    cone, total = abs(lens.paraxial.entrance.radius) / lens.focal_length, sums(lens)
    tangential, sagittal = field_curvature(lens, np.array([0.1]))
    scale = -0.01 / 2 / cone**2
    assert tangential[0] == pytest.approx(scale * (3 * total["astigmatism"] + total["petzval"]), rel=0.01)
    assert sagittal[0] == pytest.approx(scale * (total["astigmatism"] + total["petzval"]), rel=0.01)

"""The catalogue against its sources: what a patent prints beside its table, and what follows from both."""

import dataclasses

import numpy as np
import pytest

from bokehnet.lenses import PrescriptionLens, load_lens
from bokehnet.lenses.surface_trace import beam_between, trace
from bokehnet.optics.aberrations.seidel import surface_sums

# US 3,583,791, example I: columns I to V of its table of Seidel coefficients, R1 to R14.
NIKKOR = """
 0.268  0.067  0.458  0.424  0.107    -3.782  0.818 -1.258 -0.904  0.195     1.041  0.194  0.424  0.352  0.065
-5.122  0.308 -0.586 -0.549  0.033     7.113  1.163  0.978  0.597  0.097     2.979 -1.506  2.515  0.992 -0.502
-2.727  1.377 -2.311 -0.921  0.465     5.613 -2.079  2.617  1.077 -0.400   -11.887  2.313 -2.012 -1.111  0.216
-2.291 -1.520 -3.253 -1.237 -0.821     0.149  0.263  1.264  0.335  0.592     4.719 -0.661  0.914  0.729 -0.102
-0.020  0.048 -0.355 -0.121  0.291     5.319 -0.784  0.684  0.453 -0.067
"""


def back_focus(lens: PrescriptionLens) -> float:
    return lens.paraxial.cardinal.rear_focus - lens.paraxial.length


@pytest.mark.parametrize(
    ("name", "focal_length", "back", "tolerance"),
    [
        # US 2,673,491: f = 1, p0' = 0.71436.
        ("double_gauss", 100.0, 71.436, 2e-4),
        # US 2,500,046: F = 100 mm, BF = 56.5.
        ("petzval", 100.0, 56.5, 1e-3),
        # US 3,583,791, example I: f = 100, Bf = 131.19; its rounded table gives 99.83 and 130.92.
        ("retrofocus", 100.0, 131.19, 2.1e-3),
        # OpticStudio's sample file: 50 mm; its image stands in the best focus.
        ("cooke_triplet", 50.0, 42.20778, 6e-3),
        # Laikin, 4th ed., p. 91: 5 inches.
        ("telephoto", 127.0, 62.98184, 7e-3),
    ],
)
def test_focal_length_and_back_focus_are_those_printed(name, focal_length, back, tolerance):
    lens = load_lens(name)
    assert lens.focal_length == pytest.approx(focal_length, rel=tolerance)
    assert back_focus(lens) == pytest.approx(back, rel=tolerance)


def test_the_double_gauss_that_kolb_mitchell_and_hanrahan_print_focuses_where_they_say():
    """A realistic camera model, SIGGRAPH 1995, table 1: f = 100, f/2, stop 34.2 across, image 72.228 behind.

    The patent's lens with indices of three digits; radii, thicknesses and clear apertures are the same.
    """
    lens = load_lens("double_gauss")
    assert next(row for row in lens.prescription.surfaces if row.stop).semi_diameter == 34.2 / 2
    printed = iter([(1.67, 47.1), (1.67, 47.1), (1.699, 30.1), (1.603, 38.0), (1.658, 57.3), (1.717, 48.0)])
    rows = tuple(
        row if row.abbe is None else dataclasses.replace(row, abbe=next(printed))
        for row in lens.prescription.surfaces
    )
    lens = PrescriptionLens(prescription=dataclasses.replace(lens.prescription, surfaces=rows))
    assert lens.focal_length == pytest.approx(100, rel=0.01)
    assert lens.min_f_number == pytest.approx(2, rel=0.02)
    assert back_focus(lens) == pytest.approx(72.228, rel=1e-3)


@pytest.mark.parametrize("name", ["double_gauss", "petzval", "retrofocus", "telephoto"])
def test_the_cone_of_light_has_the_printed_f_number(name):
    """1 / (2 sin u') of the ray through the rim of the iris, which the patents call the aperture: 1 %."""
    lens = load_lens(name)
    assert lens.working_f_number == pytest.approx(lens.prescription.f_number, rel=0.01)


def test_the_pupil_of_the_cooke_triplet_is_that_of_the_sample_file():
    """OpticStudio's prescription report: entrance pupil 10 mm across, 11.51 mm behind the first vertex."""
    entrance = load_lens("cooke_triplet").paraxial.entrance
    assert entrance.position == pytest.approx(11.51, abs=0.01)
    assert 2 * entrance.radius == pytest.approx(10.0, rel=1e-3)


def test_the_retrofocus_has_the_seidel_coefficients_that_its_patent_prints():
    """Each of 14 surfaces, for f = 1, height 1, field slope 1; a wrong digit in its row shows here.

    III and IV are 3 S3 + S4 and S3 + S4 of Welford's sums. The table prints three decimals of a design that
    has more digits than its radii, so 0.05 of the largest coefficients are allowed for all and 0.1 of coma.
    """
    lens = load_lens("retrofocus")
    focal, pupil = 100.0, lens.paraxial.entrance.position
    marginal, chief = (focal, 0.0), (-pupil, 1.0)
    place, index, results = 0.0, 1.0, []
    for surface in lens.surfaces:
        gap = (surface.vertex - place) / index
        place = surface.vertex
        marginal, chief = ((y + gap * nu, nu) for y, nu in (marginal, chief))
        if surface.stop:
            continue
        sums = surface_sums(marginal, chief, surface.curvature, 0.0, surface.before, surface.behind)
        tangential, sagittal = 3 * sums.astigmatism + sums.petzval, sums.astigmatism + sums.petzval
        results.append([sums.spherical, sums.coma, tangential, sagittal, sums.distortion])
        power = (surface.behind - surface.before) * surface.curvature
        marginal, chief = ((y, nu - power * y) for y, nu in (marginal, chief))
        index = surface.behind
    printed = np.array(NIKKOR.split(), float).reshape(14, 5)
    assert np.abs(np.array(results) / focal - printed).max(0) == pytest.approx(0, abs=0.05)
    assert np.array(results).sum(0) / focal == pytest.approx([1.372, 0.001, 0.079, 0.116, 0.169], abs=0.02)


def test_the_doublets_of_the_petzval_lens_have_the_ratios_that_its_patent_prints():
    """US 2,500,046, last column of the second table, two digits, doublets counted as thin lenses.

    f1 = 1.8 F = 1.2 f2, R1 = 0.4 f1, -R2 = 0.32 f1, -R4 = 0.43 R7.
    """
    surfaces = [surface for surface in load_lens("petzval").surfaces if not surface.stop]
    powers = [(surface.behind - surface.before) * surface.curvature for surface in surfaces]
    front, rear = 1 / sum(powers[:3]), 1 / sum(powers[3:])
    radius = [1 / surface.curvature if surface.curvature else np.inf for surface in surfaces]
    assert front / 100 == pytest.approx(1.8, abs=0.05)
    assert front / rear == pytest.approx(1.2, abs=0.005)
    assert radius[0] / front == pytest.approx(0.4, abs=0.01)
    assert -radius[1] / front == pytest.approx(0.32, abs=0.005)
    assert -radius[3] / radius[6] == pytest.approx(0.43, abs=0.005)


def test_the_petzval_lens_has_the_spherical_aberration_that_its_patent_draws():
    """US 2,500,046, fig. 3: -0.20 mm where the ray comes 18 mm from the axis, 0 again at 24 mm."""
    lens = load_lens("petzval")
    height = np.array([6.0, 18.0, 24.0])
    beam = trace(lens.surfaces, beam_between((height, 0 * height, -1.0), (height, 0 * height, 0.0)))
    (x, _, t), (dx, _, dt) = beam.position, beam.direction
    shift = t - x * dt / dx - lens.paraxial.cardinal.rear_focus
    assert shift == pytest.approx([-0.03, -0.20, 0.0], abs=0.04)

"""Copies of lenses: moved surfaces against exact laws of refraction, copies against their design."""

import dataclasses
import math

import numpy as np
import pytest

from bokehnet.errors import ConfigError, LensError, ParameterError
from bokehnet.lenses import Rays, load_lens
from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.assembly.misalignment import focus_tilt, misalignment
from bokehnet.lenses.assembly.tolerances import Tolerances, assemble_copy, elements
from bokehnet.lenses.lookup.transfer import TransferLens
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.prescription_file import SurfaceRow, read_prescription
from bokehnet.lenses.prescription_toml import prescription_toml
from bokehnet.lenses.stop_rays import chief_rays
from bokehnet.lenses.surface_trace import Surface, beam_between, rotated, trace
from bokehnet.optics.aberrations.aberration_map import term
from bokehnet.optics.sampling import disc_from_square, halton, ring_points

INDEX = 1.5168
TEN_DEGREES = math.radians(10.0)


def along_axis(x=0.0, y=0.0):
    x, y = np.atleast_1d(np.asarray(x, float)), np.atleast_1d(np.asarray(y, float))
    return beam_between((x, y, -20.0), (x, y, -19.0))


def plane(vertex, before, behind, **moved):
    return Surface(vertex=vertex, curvature=0.0, semi_diameter=30.0, before=before, behind=behind, **moved)


def test_a_tilted_plate_moves_rays_by_the_law_of_snell():
    """Born and Wolf: d = t sin(i) (1 - cos(i) / sqrt(n^2 - sin(i)^2)) across the ray, none in direction."""
    turn, thick = (TEN_DEGREES, 0.0), 8.0
    x, y, t = rotated((0.0, 0.0, thick), turn)
    plate = [
        plane(0.0, 1.0, INDEX, tilt=turn),
        plane(thick, INDEX, 1.0, tilt=turn, shift=(x, y, t - thick)),
    ]
    beam = trace(plate, along_axis())
    sine, cosine = math.sin(TEN_DEGREES), math.cos(TEN_DEGREES)
    expected = thick * sine * (1 - cosine / math.sqrt(INDEX**2 - sine**2))
    assert beam.direction[2][0] == pytest.approx(1, abs=1e-15)
    assert abs(beam.at(50.0)[1][0]) == pytest.approx(expected, rel=1e-12)
    assert beam.at(50.0)[0][0] == 0


def test_a_wedge_bends_rays_by_the_prism_law():
    """A ray square to the first side of a prism of angle a leaves at asin(n sin a) - a: the thin wedge is
    (n - 1) a."""
    wedge = [plane(0.0, 1.0, INDEX), plane(5.0, INDEX, 1.0, tilt=(0.0, TEN_DEGREES))]
    dx, _, dt = (float(part[0]) for part in trace(wedge, along_axis()).direction)
    exact = math.asin(INDEX * math.sin(TEN_DEGREES)) - TEN_DEGREES
    assert abs(math.atan2(dx, dt)) == pytest.approx(exact, rel=1e-12)
    assert exact == pytest.approx((INDEX - 1) * TEN_DEGREES, rel=0.04)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_sphere_turned_about_its_centre_is_the_same_sphere(backwards):
    radius, turn = 40.0, (0.05, -0.08)
    # The vertex goes round the centre, at t = radius.
    x, y, t = rotated((0.0, 0.0, -radius), turn)
    moved = Surface(
        vertex=0.0,
        curvature=1 / radius,
        semi_diameter=30.0,
        behind=INDEX,
        tilt=turn,
        shift=(x, y, t + radius),
    )
    rng = np.random.default_rng(0)
    ends = rng.uniform(-8, 8, (2, 2, 50))
    places = (90.0, 20.0) if backwards else (-80.0, -10.0)
    beam = beam_between((*ends[0], places[0]), (*ends[1], places[1]))
    result = trace([moved], beam, backwards=backwards)
    expected = trace([dataclasses.replace(moved, tilt=(0.0, 0.0), shift=(0.0, 0.0, 0.0))], beam, backwards)
    np.testing.assert_allclose(result.position, expected.position, atol=1e-12)
    np.testing.assert_allclose(result.direction, expected.direction, atol=1e-13)


def test_a_mirror_that_is_turned_turns_light_twice_as_far_both_ways():
    mirror = Surface(vertex=0.0, curvature=0.0, semi_diameter=30.0, mirror=True, tilt=(0.03, 0.0))
    beam = trace([mirror], along_axis())
    _, dy, dt = (float(part[0]) for part in beam.direction)
    assert abs(math.atan2(dy, dt)) == pytest.approx(0.06, rel=1e-12)
    # Back along the same ray: from the sensor's side, axis turned with the light.
    end, near = ([float(part[0]) for part in beam.at(t)] for t in (50.0, 49.0))
    back = trace(
        [mirror],
        beam_between((np.array([end[0]]), np.array([end[1]]), 50.0), (*near, 49.0)),
        backwards=True,
    )
    assert float(back.direction[1][0]) == pytest.approx(0, abs=1e-12)


def test_a_rim_moves_with_its_element():
    ring = Surface(vertex=0.0, curvature=0.0, semi_diameter=5.0, shift=(3.0, 0.0, 0.0))
    passes = trace([ring], along_axis([-2.5, -1.5, 7.5, 8.5], [0.0] * 4)).passes
    assert passes.tolist() == [False, True, True, False]


def moved_as_one(prescription, shift):
    rows = (row if row.stop else dataclasses.replace(row, shift=shift) for row in prescription.surfaces)
    return dataclasses.replace(prescription, surfaces=tuple(rows))


def test_a_singlet_off_its_stop_has_the_coma_of_its_spherical_aberration():
    """With E = S (a.a) a a pupil moved by d radii adds S (2 (a.d) a + (a.a) d), coma.

    Oracle for S, and for the coma of the design: its aberration map. Welford 1986, 8.
    """
    lens = load_lens("biconvex", f_number=16.0)
    moved = 0.3
    copy = PrescriptionLens(prescription=moved_as_one(lens.prescription, (moved, 0.0, 0.0)), f_number=16.0)
    along, across = fit_aberration_map(lens, wavelengths=()).transverse_aberration[0]
    radius = lens.prescription.image_radius
    result = misalignment(copy)
    # The lens moves to the sensor's +x, which is the picture's left: rays pass it further right by d, and
    # what the middle of the sensor shows is right of its axis, where the lens has a coma of its own.
    expected = along[term(1, 0, 0)] * moved / lens.thick.pupil_radius + across[term(1, 0, 0)] * moved / radius
    assert result.coma[0] == pytest.approx(2 * expected * radius, rel=0.03)
    assert abs(result.coma[1]) < 1e-3 * abs(result.coma[0])
    assert np.abs(misalignment(lens).coma).max() < 1e-9
    # In focus at infinity the picture moves with the lens.
    assert result.image_shift[0] == pytest.approx(-moved, rel=0.01)


@pytest.mark.parametrize("name", ["double_gauss", "petzval"])
def test_the_focus_plane_agrees_with_a_search_through_focus(name):
    """Oracle: the sensor, moved to and fro, on which the traced spot is least, on both sides."""
    lens_copy = assemble_copy(load_lens(name).prescription, Tolerances() * 10, 3)
    lens = PrescriptionLens(prescription=lens_copy, f_number=8.0, focus_distance=3000.0)
    radius = 0.7 * lens_copy.image_radius
    sharpest = np.array([sharpest_sensor(lens, np.array(place)) for place in radius * np.array(AROUND)])
    # Blur of a sensor in front of the image by so many mm, per mm from side to side.
    expected = (sharpest[::2] - sharpest[1::2]) / (2 * radius) / (2 * lens.working_f_number)
    assert np.linalg.norm(focus_tilt(lens) - expected) < 0.06 * np.linalg.norm(expected)
    assert focus_tilt(lens.centred) == (0, 0)


AROUND = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]


def sharpest_sensor(lens, place):
    """Return the backward shift of the sensor, mm, with the smallest spot of the point at ``place``."""
    middle = chief_rays(lens, place)
    away = 1.2 * lens.thick.pupil_radius * ring_points(16)
    rays = Rays(origin=middle.origin + away, slope=middle.slope - away / lens.focus_distance)
    shifts = np.linspace(-2, 2, 81)
    sizes = []
    for shift in shifts:
        moved = dataclasses.replace(lens)
        vars(moved)["focus_shift"] = lens.focus_shift + shift
        reached, passes = moved.trace_to_sensor(rays)
        sizes.append(float(reached[passes].var(0).sum()))
    return float(-np.polyfit(shifts, sizes, 2)[1] / np.polyfit(shifts, sizes, 2)[0] / 2)


def test_elements_are_what_one_rim_holds():
    assert elements(load_lens("double_gauss").prescription) == [(0, 1), (2, 3, 4), (6, 7, 8), (9, 10)]


def test_the_slider_moves_one_copy_within_its_limits_and_not_the_iris():
    design = load_lens("retrofocus").prescription
    assert assemble_copy(design, Tolerances() * 0, 5) == design
    small, large = (assemble_copy(design, Tolerances() * strength, 5) for strength in (1.0, 2.0))
    assert small == assemble_copy(design, Tolerances(), 5) != assemble_copy(design, Tolerances(), 6)
    for row, at_one, at_two in zip(design.surfaces, small.surfaces, large.surfaces, strict=True):
        assert math.hypot(*at_one.tilt) <= 0.02 + 1e-12
        # The middle of an element, not each of its vertices, is what the limit is of.
        assert math.hypot(*at_one.shift[:2]) <= 0.02 + math.radians(0.02) * 40
        assert at_two.tilt == pytest.approx([2 * angle for angle in at_one.tilt])
        assert abs(at_one.thickness - row.thickness) <= 0.02 + 1e-12
        if row.medium() is not None:
            assert at_one.thickness == row.thickness
        if row.stop:
            assert at_one.shift == (0, 0, 0)
    assert small.centred is False
    assert small.with_surfaces_centred().centred


def test_a_copy_is_written_and_read_back_and_scaled(tmp_path):
    lens_copy = assemble_copy(load_lens("petzval").prescription, Tolerances(), 1)
    path = tmp_path / "copy.toml"
    path.write_text(prescription_toml(lens_copy), encoding="utf-8")
    assert read_prescription(path) == lens_copy
    assert lens_copy.scaled(2.0).surfaces[0].shift == tuple(2 * part for part in lens_copy.surfaces[0].shift)
    with pytest.raises(LensError, match="pass the design"):
        assemble_copy(lens_copy, Tolerances(), 2)
    with pytest.raises(LensError, match="expected elements centred on the axis"):
        _ = TransferLens(prescription=lens_copy, degree=2).table


def test_light_of_a_copy_is_all_looked_for():
    """Rays aimed where a copy lets light pass tell the same light as rays aimed far beyond its exit pupil."""
    lens_copy = assemble_copy(load_lens("double_gauss").prescription, Tolerances() * 10, 3)
    lens = PrescriptionLens(prescription=lens_copy, f_number=2.8, focus_distance=3000.0)
    uv = disc_from_square(np.stack([halton(8192, 2), halton(8192, 3)], -1))
    wide = dataclasses.replace(lens, pupil_sampling="exit")
    for place in ((0.0, 25.0), (-30.0, 0.0)):
        sensor = np.broadcast_to(place, uv.shape)
        light = lens.sample_rays(sensor, uv).weight.mean()
        assert light == pytest.approx(1.5**2 * wide.sample_rays(sensor, 1.5 * uv).weight.mean(), rel=0.01)


def test_what_cannot_be_moved_is_refused(tmp_path):
    stop = SurfaceRow(thickness=1.0, semi_diameter=5.0, stop=True, shift=(0.1, 0.0, 0.0))
    assert "stays on the axis" in str(stop.problem(None))
    steep = SurfaceRow(thickness=1.0, semi_diameter=5.0, tilt=(0.0, 60.0))
    assert str(steep.problem(None)).startswith("tilt: expected less than 45")
    with pytest.raises(ParameterError, match="decentre"):
        Tolerances(decentre=-1.0)
    path = tmp_path / "copy.toml"
    text = prescription_toml(assemble_copy(load_lens("petzval").prescription, Tolerances(), 1))
    path.write_text(text.replace("tilt = [", "tilt = [1.0, ", 1), encoding="utf-8")
    with pytest.raises(ConfigError, match="tilt"):
        read_prescription(path)

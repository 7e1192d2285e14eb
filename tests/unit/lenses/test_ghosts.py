"""Ghosts against rays that are traced one by one, and against the reflection of a plane."""

import math

import numpy as np
import pytest

from bokehnet.lenses import PrescriptionLens, load_lens
from bokehnet.lenses.ghosts import trace_ghosts
from bokehnet.lenses.prescription_file import Prescription, SurfaceRow
from bokehnet.lenses.stop_rays import chief_rays


def sequential(lens, slope, start, near, far, clip=True):
    """Oracle: one ray, surface after surface, forwards to ``far``, back to ``near``, forwards to the sensor.

    Spheres are met by the quadratic equation of their centre; Snell's law by the sine and a rotation.
    """
    surfaces = lens.surfaces
    point = np.array([*start, float(surfaces[0].vertex)])
    ray = np.array([-slope[0], -slope[1], 1.0])
    ray /= np.linalg.norm(ray)
    point = point - ray * 50
    steps = [(i, 1, i == far) for i in range(far + 1)]
    steps += [(i, -1, i == near) for i in range(far - 1, near - 1, -1)]
    steps += [(i, 1, False) for i in range(near + 1, len(surfaces))]
    for number, sign, reflects in steps:
        surface = surfaces[number]
        vertex = np.array([0, 0, float(surface.vertex)])
        curvature = 0.0 if surface.stop else float(surface.curvature)
        if curvature == 0:
            point = point + ray * (vertex[2] - point[2]) / ray[2]
            normal = np.array([0, 0, 1.0])
        else:
            centre = vertex + np.array([0, 0, 1 / curvature])
            away = point - centre
            b, c = ray @ away, away @ away - curvature**-2
            if b * b < c:
                return None
            roots = [-b - math.sqrt(b * b - c), -b + math.sqrt(b * b - c)]
            point = point + ray * min(roots, key=lambda s: abs((point + ray * s - vertex)[2]))
            normal = (centre - point) * curvature
        if math.hypot(point[0], point[1]) > float(surface.semi_diameter) and clip:
            return None
        if surface.stop:
            continue
        normal = normal / np.linalg.norm(normal)
        if reflects:
            ray = ray - 2 * (ray @ normal) * normal
            continue
        before, behind = float(surface.before), float(surface.behind)
        before, behind = (before, behind) if sign > 0 else (behind, before)
        axis = normal if ray @ normal > 0 else -normal
        tangent = (ray - (ray @ axis) * axis) * before / behind
        if tangent @ tangent >= 1:
            return None
        ray = tangent + math.sqrt(1 - tangent @ tangent) * axis
    point = point + ray * (lens.sensor_position - point[2]) / ray[2]
    return -point[:2]


@pytest.mark.parametrize("name", ["double_gauss", "cooke_triplet", "retrofocus", "petzval"])
def test_rays_fall_where_a_sequential_trace_with_reflections_has_them(name):
    """Every pair of surfaces; 1e-6 of the half-diagonal is a thousandth of a pixel at 1080 rows."""
    lens = load_lens(name, f_number=8.0)
    place = (0.4 * lens.prescription.image_radius, -0.25 * lens.prescription.image_radius)
    slope = chief_rays(lens, np.array(place)).slope
    side, seen = 15, 0
    axis = ((np.arange(side) + 0.5) * (2 / side) - 1) * 1.08 * float(lens.surfaces[0].semi_diameter)
    for ghost in trace_ghosts(lens, place, side=side):
        passes = np.argwhere(ghost.fill <= 1)
        for row, column in passes[:6]:
            start = (axis[column], axis[row])
            expected = sequential(lens, slope, start, *ghost.surfaces)
            assert expected is not None
            apart = np.abs(ghost.place[row, column] - expected).max()
            assert apart < 1e-6 * lens.prescription.image_radius
            seen += 1
    assert seen > 50


def test_a_plate_reflects_by_the_fresnel_equations():
    """A bare plate of index 1.5 in front of the lens: its ghost is in the lamp's own place, 0.04^2 of it."""
    lens = load_lens("biconvex", f_number=16.0)
    plate = (
        SurfaceRow(thickness=3.0, semi_diameter=20.0, abbe=(1.5, 60.0)),
        SurfaceRow(thickness=10.0, semi_diameter=20.0),
    )
    source = lens.prescription
    whole = Prescription(
        name="Plate", source="", focal_length=source.focal_length, f_number=source.f_number,
        image_radius=source.image_radius, surfaces=(*plate, *source.surfaces),
    )  # fmt: skip
    with_plate = PrescriptionLens(prescription=whole, f_number=16.0)
    at = (0.1, 0.0)
    ghost = next(iter(trace_ghosts(with_plate, at, coating="none", side=64)))
    assert ghost.surfaces == (0, 1)
    assert ghost.place[ghost.fill <= 1].mean(0) == pytest.approx(at, abs=5e-3)
    assert ghost.relative_flux == pytest.approx(0.04**2, rel=0.02)


def test_coating_takes_ghosts_away():
    lens = load_lens("double_gauss", f_number=4.0)
    shares = {
        coating: sum(g.relative_flux for g in trace_ghosts(lens, (8.0, 3.0), coating=coating, side=12))
        for coating in ("none", "single", "ideal")
    }
    assert shares["none"] > 4 * shares["single"] > 4 * shares["ideal"] > 0
    bare = [row for row in lens.surfaces if not row.stop and min(row.before, row.behind) == 1]
    reflected = sum(((row.before - row.behind) / (row.before + row.behind)) ** 2 for row in bare)
    assert shares["none"] < reflected**2 / 2  # as if all of each pair's light came to the sensor

"""Mirrors: the tracer against the mirror equation, prescriptions against telescopes of textbooks."""

import math
from pathlib import Path

import numpy as np
import pytest

from bokehnet.classical.highlights.psf_images import passing, vignetting_shares
from bokehnet.classical.layered.march.aberrated_rays import keep_within
from bokehnet.classical.simd.float8 import broadcast8, load8, store8
from bokehnet.errors import ConfigError
from bokehnet.kernels import njit
from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.wavefront import trace_wavefront
from bokehnet.lenses.catalog import load_lens
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.prescription_file import Prescription, SurfaceRow, read_prescription
from bokehnet.lenses.pupils.paraxial_lens import paraxial_lens
from bokehnet.lenses.seidel_lens import seidel_by_surface
from bokehnet.lenses.surface_trace import Beam, Surface, beam_between, trace
from bokehnet.optics.aperture import Aperture


def _parallel(height: np.ndarray) -> Beam:
    return beam_between((height, 0 * height, -20.0), (height, 0 * height, -19.0))


def test_a_paraboloid_has_one_focus() -> None:
    mirror = Surface(vertex=0.0, curvature=-1 / 200, semi_diameter=60, conic=-1.0, mirror=True)
    beam = trace([mirror], _parallel(np.linspace(-50, 50, 11)))
    assert np.abs(beam.at(100.0)[0]).max() < 1e-12


def test_rays_that_come_back_go_the_same_way() -> None:
    surfaces = load_lens("catadioptric").surfaces
    height = np.linspace(30, 60, 7)
    start = _parallel(height)
    through = trace(surfaces, start)
    assert through.passes.all()
    end = through.at(900.0)
    far = through.at(901.0)
    back = trace(surfaces, beam_between((*far, 901.0), (*end, 900.0)), backwards=True)
    assert back.at(-20.0)[0] == pytest.approx(height, abs=1e-9)


def _cassegrain(primary: float, gap: float, secondary: float) -> Prescription:
    rows = (
        SurfaceRow(thickness=gap, semi_diameter=15.0, inner_radius=4.0),
        SurfaceRow(thickness=0.0, semi_diameter=10.0, stop=True),
        SurfaceRow(radius=primary, thickness=gap, semi_diameter=11.0, conic=-1.0, mirror=True),
        SurfaceRow(radius=secondary, thickness=24.0, semi_diameter=4.0, conic=-3.236, mirror=True),
    )
    return Prescription(
        name="Cassegrain", source="", focal_length=80.0, f_number=4.0, image_radius=1.0, surfaces=rows
    )


def test_a_cassegrain_has_the_focal_length_of_its_mirrors() -> None:
    """Handbook of optics, 1995, 2.18, example 3: f = f1 f2 / (f1 + f2 - d), and stigmatic on the axis."""
    one, two, gap = 45.72 / 2, -19.2 / 2, 16.0
    design = _cassegrain(-45.72, gap, 19.2)
    lens = PrescriptionLens(prescription=design)
    assert lens.focal_length == pytest.approx(one * two / (one + two - gap), rel=1e-12)
    assert trace_wavefront(lens, 0.0, count=33).rms < 2e-3
    assert abs(sum(sums["spherical"] for _, sums in seidel_by_surface(lens))) < 1e-5


def test_seidel_sums_of_a_sphere_are_those_of_its_rays() -> None:
    """A sphere's rays meet the axis h^2 / (4 R) short of the focus: S1 = h^4 / R^3 / ... by third order."""
    radius, height = 200.0, 5.0
    mirror = Surface(vertex=0.0, curvature=-1 / radius, semi_diameter=60, mirror=True)
    beam = trace([mirror], _parallel(np.array([height])))
    miss = float(beam.at(radius / 2)[0][0])
    assert miss == pytest.approx(-(height**3) / (2 * radius**2), rel=0.01)
    assert float(paraxial_lens([_stop(), mirror]).cardinal.focal_length) == pytest.approx(radius / 2)


def _stop() -> Surface:
    return Surface(vertex=0.0, curvature=0.0, semi_diameter=10.0, stop=True)


def test_the_middle_of_a_mirror_lens_is_dark_where_its_rays_are() -> None:
    lens = load_lens("catadioptric")
    aberrations = fit_aberration_map(lens, wavelengths=())
    dark = [rim for rim in aberrations.vignetting_apertures if rim[1] < 0]
    assert len(dark) == 1
    # The back of the secondary mirror over the entrance pupil, both from the source.
    assert -dark[0][1] == pytest.approx(25 / abs(lens.paraxial.entrance.radius), abs=0.01)
    pupil = np.array([[0.1, 0.0], [0.6, 0.0], [1.2, 0.0]])
    assert aberrations(pupil, np.zeros((3, 2)))[2].tolist()[:2] == [False, True]
    sensor, places = np.zeros((200, 2)), np.linspace(-1, 1, 200)
    weight = lens.sample_rays(sensor, np.stack([places, 0 * places], -1)).weight
    assert (weight[np.abs(places) < 0.35] == 0).all()
    assert (weight[(np.abs(places) > 0.42) & (np.abs(places) < 0.95)] > 0).all()


def test_mirrors_are_printed_as_rows() -> None:
    glass = SurfaceRow(radius=-200.0, thickness=10.0, semi_diameter=20.0, abbe=(1.5, 60.0))
    wrong = SurfaceRow(radius=-300.0, thickness=10.0, semi_diameter=20.0, mirror=True)
    assert "named again" in str(wrong.problem(glass.medium()))
    dark = SurfaceRow(thickness=1.0, semi_diameter=5.0, inner_radius=5.0)
    assert str(dark.problem(None)).startswith("inner_radius: expected 0 to less than 5")


def test_a_mirror_lens_is_written_and_read_back(tmp_path: Path) -> None:

    from bokehnet.lenses.prescription_toml import prescription_toml

    design = load_lens("catadioptric").prescription
    path = tmp_path / "mirror.toml"
    path.write_text(prescription_toml(design), encoding="utf-8")
    assert read_prescription(path) == design
    path.write_text(prescription_toml(design).replace("mirror = true", "mirror = 3"), encoding="utf-8")
    with pytest.raises(ConfigError, match="mirror"):
        read_prescription(path)


def test_the_catadioptric_lens_is_as_published() -> None:
    """US 5,331,467: f = 1000 mm, f/7.5; ray-optics says 999.639 mm of the same file with its own glasses."""
    lens = load_lens("catadioptric")
    assert lens.focal_length == pytest.approx(999.639, abs=0.05)
    assert lens.min_f_number == pytest.approx(7.5, abs=0.01)
    back = float(lens.paraxial.cardinal.rear_focus - lens.paraxial.length)
    assert math.isclose(back, 75.7409, abs_tol=0.4)


@njit
def _kept(us, vs, radius, result):  # type: ignore[no-untyped-def]
    one = broadcast8(np.float32(1))
    store8(result, 0, keep_within(load8(us, 0), load8(vs, 0), np.float32(0.1), np.float32(0), radius, one))


def test_kernels_know_what_is_dark_inside() -> None:
    places = np.linspace(-0.7, 0.7, 8).astype(np.float32)
    for radius in (0.45, -0.45):
        result = np.zeros(8, np.float32)
        _kept(places, 0 * places, radius, result)
        inside = np.abs(places - 0.1) <= 0.45
        assert (result == (inside if radius > 0 else ~inside)).all()
        soft = [passing(np.array([[0.1, radius]]), float(u), 0.0, 1.0, 0.0, 1e6) for u in places]
        assert soft == pytest.approx(result.tolist())
        light = vignetting_shares(Aperture(), ((0.0, radius),))[0]
        assert light[0, 0] == pytest.approx(0.2025 if radius > 0 else 0.7975, abs=0.01)

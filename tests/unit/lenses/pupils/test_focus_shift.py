"""Focus on the sharpest plane: against third-order theory and a search through focus."""

import numpy as np
import pytest

from bokehnet.lenses import Rays, load_lens
from bokehnet.lenses.seidel_lens import reduce_lens
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.optics.sampling import disc_from_square, halton

SQUARE = np.stack([halton(4096, 2), halton(4096, 3)], -1)


def spot_radius(lens, behind: float) -> float:
    """Root mean square radius of a point in focus, mm, on a sensor so far behind that of the lens."""
    origin = 1.4 * lens.thick.pupil_radius * disc_from_square(SQUARE)
    rays = Rays(origin=origin, slope=-origin / lens.focus_distance)
    here, passes = lens.trace_to_sensor(rays)
    exit_pupil = lens.paraxial.exit.position
    moved = here[passes] + behind / (lens.sensor_position - exit_pupil) * (
        here[passes] - leaves(lens, rays)[passes]
    )
    return float(np.sqrt((moved**2).sum(-1).mean()))


def leaves(lens, rays) -> np.ndarray:
    """Return the positions of rays in the exit pupil, mm: by the same lens with its sensor there."""
    moved = type(lens)(
        prescription=lens.prescription, f_number=lens.f_number, focus_distance=lens.focus_distance
    )
    vars(moved)["focus_shift"] = lens.paraxial.exit.position - lens.gaussian_focus
    return moved.trace_to_sensor(rays)[0]


@pytest.mark.parametrize("name", ["biconvex", "double_gauss", "petzval", "retrofocus", "telephoto"])
def test_no_other_plane_blurs_a_point_less(name):
    """Oracle: traced spots on sensors in front and behind; the paraxial one is worse by what it shows."""
    lens = load_lens(name, focus_distance=30 * load_lens(name).focal_length)
    step = 0.02 * abs(lens.focus_shift) + 0.002
    least = spot_radius(lens, 0.0)
    assert spot_radius(lens, step) > least < spot_radius(lens, -step)
    assert spot_radius(lens, -lens.focus_shift) > least


def test_a_singlet_focuses_at_two_thirds_of_its_spherical_aberration():
    """Third order: E = S a^3, least at -2/3 S of defocus; the biconvex lens at f/16 has little else."""
    lens = load_lens("biconvex", f_number=16.0, focusing="paraxial")
    spherical = float(reduce_lens(lens, half_diagonal=1.0, wavelengths=[587.5618]).image.spherical[0])
    radius, distance = abs(lens.paraxial.exit.radius), lens.sensor_position - lens.paraxial.exit.position
    result = load_lens("biconvex", f_number=16.0).focus_shift * radius / distance
    assert abs(result) == pytest.approx(2 / 3 * abs(spherical), rel=0.02)


def test_the_shift_grows_as_the_square_of_the_opening():
    """Welford 1986, 6.3: longitudinal spherical aberration of the third order."""
    wide, narrow = (load_lens("biconvex", f_number=n).focus_shift for n in (11.0, 22.0))
    assert wide / narrow == pytest.approx(4, rel=0.02)
    assert load_lens("biconvex", f_number=11.0, focusing="paraxial").focus_shift == 0


def test_the_telephoto_lens_forms_its_image_at_the_published_distance():
    """Laikin, 4th ed., p. 91: 2.4796 inches behind the last surface, which is not the paraxial 2.4963."""
    lens = load_lens("telephoto")
    assert (lens.sensor_position - lens.paraxial.length) / 25.4 == pytest.approx(2.4796, abs=6e-4)


@pytest.mark.parametrize("strength", [-2.5, 0.4])
def test_a_slider_focuses_where_its_blur_is_least(strength):
    """Root mean square over the pupil of the transverse aberration in focus, against a scan of defocus."""
    pupil, field = disc_from_square(SQUARE), np.zeros((len(SQUARE), 2))

    def blur(defocus: float, focusing: str) -> float:
        aberrations = AberrationSliders(spherical=strength, focusing=focusing).aberration_map()
        return float((((aberrations(pupil, field)[0] + defocus * pupil) ** 2).sum(-1).mean()) ** 0.5)

    scan = np.linspace(-1, 1, 401) * abs(strength) / 100
    assert blur(0.0, "sharpest") <= 1.001 * min(blur(s, "paraxial") for s in scan)
    assert blur(0.0, "paraxial") > 2.9 * blur(0.0, "sharpest")

"""Darker corners: against light sent from the scene, counted by étendue, and the cos^4 law."""

import numpy as np
import pytest

from bokehnet.lenses import Rays, ThinLens, load_lens
from bokehnet.lenses.aberrations.relative_illumination import relative_illumination


def by_etendue(lens, slope: float, count: int = 400) -> tuple[float, float]:
    """Return the height of parallel light of a slope, mm, and its irradiance: L cos A dOmega / dA."""
    half = 3.0 * lens.thick.pupil_radius
    steps = (np.arange(count) + 0.5) / count * 2 * half - half
    origin = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)

    def arrive(at: float) -> tuple[float, float]:
        rays = Rays(origin=origin, slope=np.broadcast_to([at, 0.0], origin.shape))
        xy, passes = lens.trace_to_sensor(rays)
        return -float(xy[passes, 0].mean()), float(passes.mean()) * (2 * half) ** 2

    step = 1e-3
    (low, _), (height, area), (high, _) = (arrive(at) for at in (slope - step, slope, slope + step))
    angle, cosine = np.arctan(slope), np.cos(np.arctan(slope))
    solid = np.sin(angle) * cosine**2 * 2 * step  # dOmega over the turn about the axis
    return height, cosine * area * solid / (height * (high - low))


@pytest.mark.parametrize("name", ["double_gauss", "petzval", "retrofocus"])
def test_light_in_the_corners_is_what_the_scene_sends_there(name):
    """Radiometry, independent of pupils: 2 %, wide open, at half and nine tenths of the field."""
    lens = load_lens(name)
    radius = lens.prescription.image_radius
    light = relative_illumination(lens, radius)
    _, middle = by_etendue(lens, 0.02)
    for share in (0.5, 0.9):
        height, result = by_etendue(lens, share * radius / lens.sensor_distance)
        expected = np.interp(height / radius, np.linspace(0, 1, 33), light)
        assert result / middle == pytest.approx(expected, abs=0.02)


def test_a_stopped_down_lens_follows_the_cosine():
    """Light of a small exit pupil at D: cos^4 of the angle, while its size stays; the Cooke triplet, 3 %."""
    lens = load_lens("cooke_triplet", f_number=16.0)
    light = relative_illumination(lens, 8.0)
    distance = lens.sensor_position - lens.paraxial.exit.position
    assert light[-1] == pytest.approx(np.cos(np.arctan(8.0 / distance)) ** 4, rel=0.03)
    assert (np.diff(light) < 1e-3).all()


def test_a_lens_without_weights_is_even():
    assert (relative_illumination(ThinLens(focal_length=50.0, f_number=2.0), 20.0) == 1).all()

"""Looks fitted to pairs of pictures of known ones."""

import numpy as np
import pytest

from bokehnet.classical.scatter_renderer import scatter
from bokehnet.errors import LensError, ShapeError
from bokehnet.optics.aperture import Aperture
from bokehnet.tools import pair_fit as module
from bokehnet.tools.pair_fit import fit_pair

HEIGHT, WIDTH = 80, 120


def pair(aperture, blur=0.24, focus=30.0):
    """Lamps over a ramp of depth and a wall, blurred by a known look, darker by a fifth, with noise."""
    rng = np.random.default_rng(0)
    image = rng.uniform(0.02, 0.06, (HEIGHT, WIDTH, 3))
    for y, x in zip(rng.integers(8, HEIGHT - 8, 14), rng.integers(8, WIDTH - 8, 14), strict=True):
        image[y, x] += rng.uniform(20, 60, 3)
    image = image.astype(np.float32)
    disparity = np.broadcast_to(np.linspace(10, 60, HEIGHT)[:, None], (HEIGHT, WIDTH)).copy()
    defocus = (blur * (disparity - focus)).astype(np.float32)
    blurred = 0.8 * scatter(image, defocus, aperture=aperture)
    return image, disparity, blurred + rng.normal(size=blurred.shape).astype(np.float32) * 0.002


@pytest.mark.slow
def test_a_pair_names_blur_focus_and_aperture(monkeypatch):
    """Authority: the scatter that made it; each within 5 % of its range."""
    monkeypatch.setattr(module, "_STARTS", 1)
    monkeypatch.setattr(module, "_ITERATIONS", 7)
    truth = Aperture(blades=6, curvature=0.2, rotation=10.0, spherical_profile=0.3, cats_eye=0.5)
    result = fit_pair(*pair(truth), blades=(6,))
    assert result.blur == pytest.approx(0.24, rel=0.03)
    assert result.focus == pytest.approx(30.0, abs=0.5)
    assert result.look.blades == 6
    assert result.look.curvature == pytest.approx(0.2, abs=0.05)
    assert result.look.rotation == pytest.approx(10.0, abs=3.0)
    assert result.look.spherical_profile == pytest.approx(0.3, abs=0.1)
    assert result.look.cats_eye == pytest.approx(0.5, abs=0.075)
    assert result.look.obstruction < 0.05
    assert result.residuals[6] < 0.9 * result.residuals[0]


def test_what_cannot_be_fitted_is_refused():
    image, disparity, blurred = pair(Aperture())
    with pytest.raises(LensError, match="disparity: expected things at several depths"):
        fit_pair(image, np.ones_like(disparity), blurred)
    with pytest.raises(ShapeError, match="of one size"):
        fit_pair(image, disparity[1:], blurred)
    with pytest.raises(LensError, match="blurred: expected light below white"):
        fit_pair(image, disparity, np.ones_like(blurred))

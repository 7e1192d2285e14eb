"""Lenses as looks."""

import numpy as np
import pytest

from bokehnet.lenses import load_lens
from bokehnet.lenses.aberrations.lens_preset import lens_preset
from bokehnet.lenses.aberrations.relative_illumination import relative_illumination


@pytest.mark.slow
def test_a_look_is_the_lens():
    """Authority: rays traced through the glass, for the blur of points and for the light in the corners.

    0.99 is what a map has to reach (``test_point_spread``); 12,000 rays leave noise that costs 0.004 of it.
    """
    lens = load_lens("petzval", f_number=2.8, focus_distance=3000.0)
    preset = lens_preset(lens)
    assert preset.correlation > 0.99
    assert preset.min_correlation > 0.99
    place = np.linspace(0, 1, 11)
    light = relative_illumination(lens, lens.prescription.image_radius, 11)
    result = preset.vignette.factor(np.stack([place, 0 * place], -1), 1.5)
    assert np.abs(result - light).max() < preset.light_error + 0.01
    assert preset.light_error < 0.03

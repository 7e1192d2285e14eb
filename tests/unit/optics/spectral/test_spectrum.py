import numpy as np
import pytest
import torch

from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH, wavelength_color


def test_the_whole_spectrum_is_white():
    wavelength = np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, 4001)
    assert wavelength_color(wavelength).mean(0).tolist() == pytest.approx([1, 1, 1], abs=2e-3)


def test_pure_colours_have_their_known_appearance():
    """Authority: names of colours, CIE 1931: 450 nm is blue, 540 nm green, 620 nm red."""
    for wavelength, channel in ((450.0, 2), (540.0, 1), (620.0, 0)):
        color = wavelength_color(np.float64(wavelength))
        assert color.argmax() == channel
        assert color[channel] > 1


def test_luminance_peaks_where_the_eye_does():
    """Authority: CIE 1931 y-bar, 1 at 555 nm and 0.503 at 510 nm (tabulated); the fit errs by 1 or 2 %.

    The result has another white than XYZ, so it is taken before that is changed.
    """
    from bokehnet.optics.spectral.spectrum import _rgb

    wavelength = np.arange(400.0, 700.0)
    luminance = _rgb(wavelength) @ [0.2126, 0.7152, 0.0722]
    assert wavelength[luminance.argmax()] == pytest.approx(555, abs=4)
    assert luminance.max() == pytest.approx(1, abs=0.02)
    assert luminance[110] == pytest.approx(0.503, abs=0.02)


def test_tensors_and_arrays_agree():
    wavelength = np.linspace(380, 720, 50)
    assert np.allclose(wavelength_color(torch.from_numpy(wavelength)).numpy(), wavelength_color(wavelength))

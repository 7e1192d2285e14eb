"""Reflectance against Fresnel's numbers and a matrix of the film."""

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.optics.spectral.coating import reflectance

COSINES = np.cos(np.radians([0, 20, 45, 70]))


def by_matrix(before, film, behind, cosine, wavelength):
    """Authority: characteristic matrix of a film, Macleod, "Thin-film optical filters", 2.3."""
    sine = before * np.sqrt(1 - cosine**2)
    a, b, c = (np.sqrt(1 - (sine / n) ** 2) for n in (before, film, behind))
    delta = 2 * np.pi / wavelength * film * (550 / 4 / film) * b
    shares = []
    for incident, layer, substrate in (
        (before * a, film * b, behind * c),
        (before / a, film / b, behind / c),
    ):
        field = np.cos(delta) + 1j * np.sin(delta) * substrate / layer
        other = 1j * layer * np.sin(delta) + substrate * np.cos(delta)
        shares.append(abs((incident * field - other) / (incident * field + other)) ** 2)
    return sum(shares) / 2


def test_bare_glass_reflects_four_percent_and_polarises_at_brewsters_angle():
    assert reflectance(1.0, 1.5, np.array(1.0), 550, "none") == pytest.approx(0.04)
    brewster = np.cos(np.arctan(1.5))
    across = ((1.5**2 - 1) / (1.5**2 + 1)) ** 2
    assert reflectance(1.0, 1.5, brewster, 550, "none") == pytest.approx(across / 2)


@pytest.mark.parametrize("wavelength", [450.0, 550.0, 650.0])
def test_a_layer_reflects_as_its_transfer_matrix(wavelength):
    for before, behind in ((1.0, 1.7), (1.7, 1.0)):
        cosine = np.sqrt(1 - (1 - COSINES**2) / before**2)
        for coating, film in (("single", 1.38), ("ideal", np.sqrt(1.7))):
            result = reflectance(before, behind, cosine, wavelength, coating)
            np.testing.assert_allclose(
                result, by_matrix(before, film, behind, cosine, wavelength), rtol=1e-9, atol=1e-15
            )


def test_total_reflection_is_whole_and_cement_has_no_layer():
    assert reflectance(1.7, 1.0, np.array(0.2), 550, "none") == pytest.approx(1)
    assert reflectance(1.7, 1.0, np.array(0.2), 550, "single") == pytest.approx(1)
    cement = (reflectance(1.5, 1.7, COSINES, 550, coating) for coating in ("none", "single"))
    np.testing.assert_array_equal(*cement)


def test_an_unknown_coating_is_refused():
    with pytest.raises(ParameterError, match="coating: expected one of ideal, none, single"):
        reflectance(1.0, 1.5, COSINES, 550, "butter")

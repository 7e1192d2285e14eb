"""Absorption of light in glass.

Source: Lambert-Beer law, which thesis 001 (BokehLab), 2.2.5, names (glass "has non-zero absorbance").
"""

from bokehnet.checks import Array

__all__ = ["REFERENCE_THICKNESS_MM", "internal_transmittance"]

# Thickness for which catalogues print the internal transmittance, mm.
REFERENCE_THICKNESS_MM = 10.0


def internal_transmittance(reference: Array, path: Array) -> Array:
    """Return the fraction of light that glass transmits inside, without its surfaces.

    Args:
        reference: Internal transmittance of 10 mm of the glass, 0 to 1, any shape.
        path: Length of the ray in the glass, mm.
    """
    return reference ** (path / REFERENCE_THICKNESS_MM)

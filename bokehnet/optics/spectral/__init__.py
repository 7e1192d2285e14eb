"""Wavelengths: glasses, coatings, colours of the spectrum, diffraction and scattering."""

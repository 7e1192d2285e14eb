"""Aberrated lenses of several tests."""

from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aberrations.sliders import AberrationSliders

# Response of a lens with coma and field curvature.
CHARACTER = LensResponse(aberration_map=AberrationSliders(coma=2.0, field_curvature=1.0).aberration_map())

# Aberration map with spherical aberration, coma and astigmatism.
GLASS = AberrationSliders(spherical=0.5, coma=2.0, astigmatism=1.0).aberration_map()

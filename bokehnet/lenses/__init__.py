"""Lenses behind one interface, shared by the classical renderers and the ray tracer."""

from bokehnet.lenses.base import LensModel, Rays, defocus_map
from bokehnet.lenses.thin import ThinLens

__all__ = ["LensModel", "Rays", "ThinLens", "defocus_map"]

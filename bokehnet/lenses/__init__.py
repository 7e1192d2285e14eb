"""Lens models behind one interface, shared by the classical renderers and the ray tracer."""

from bokehnet.lenses.base import LensModel, Rays, defocus_map
from bokehnet.lenses.catalog import catalog_names, load_lens
from bokehnet.lenses.lookup.transfer import TransferLens
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.prescription_file import Prescription, read_prescription
from bokehnet.lenses.reports.depth_of_field import depth_of_field
from bokehnet.lenses.thick import ThickLens
from bokehnet.lenses.thin import ThinLens
from bokehnet.lenses.tilt_shift import TiltShift

__all__ = [
    "LensModel",
    "Prescription",
    "PrescriptionLens",
    "Rays",
    "ThickLens",
    "ThinLens",
    "TiltShift",
    "TransferLens",
    "catalog_names",
    "defocus_map",
    "depth_of_field",
    "load_lens",
    "read_prescription",
]

"""Catalogue of lenses that come with the package: one TOML file each, with its source."""

import dataclasses
import functools
import math
from pathlib import Path
from typing import Literal

from bokehnet.errors import LensError, errors_of_file
from bokehnet.lenses.assembly.tolerances import Tolerances, assemble_copy
from bokehnet.lenses.files.reading import LENS_FILES, import_lens, is_lens_file
from bokehnet.lenses.lookup.transfer_file import read_transfer
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.prescription_file import Prescription, read_prescription

__all__ = ["catalog_names", "find_prescription", "load_lens"]

_FOLDER = Path(__file__).parent
# Iterations for the positions of floating groups and of the entrance pupil, the origin of distances.
_FLOATING_ITERATIONS = 4


def catalog_names(mirrors: bool = True) -> list[str]:
    """Return the names of the lenses in the catalogue, in alphabetical order.

    Args:
        mirrors: Include lenses with mirrors, which have a central obstruction and cannot be stopped down.
    """
    names = sorted(path.stem for path in _FOLDER.glob("*.toml"))
    return names if mirrors else [name for name in names if not _has_mirrors(name)]


def _has_mirrors(name: str) -> bool:
    return any(row.mirror for row in read_prescription(_FOLDER / f"{name}.toml").surfaces)


def find_prescription(name: str | Path) -> Prescription:
    """Return a prescription from the catalogue, a TOML file, or a file of another program.

    Raises:
        LensError: ``name`` is neither in the catalogue nor a path of a known suffix, or the file is invalid.
        ConfigError: The TOML file is missing or invalid.
    """
    if str(name) in catalog_names():
        return read_prescription(_FOLDER / f"{name}.toml")
    suffix = Path(name).suffix.lower()
    if suffix == ".npz":
        return read_transfer(name).prescription
    if is_lens_file(name):
        return import_lens(name).prescription
    if suffix != ".toml":
        endings = ", ".join(LENS_FILES)
        raise LensError(
            f"unknown lens {str(name)!r}: expected a .toml file, one of other programs ({endings}), "
            f"a transfer table (.npz) or one of {', '.join(catalog_names())}"
        )
    return read_prescription(name)


def load_lens(
    name: str | Path,
    *,
    focal_length: float | None = None,
    f_number: float | None = None,
    focus_distance: float = math.inf,
    focusing: Literal["sharpest", "paraxial"] = "sharpest",
    copy_to_copy: float = 0.0,
    copy_seed: int = 0,
) -> PrescriptionLens:
    """Return a lens from the catalogue or from a file.

    Args:
        name: Name in the catalogue, or path of a lens file, as for :func:`find_prescription`; rays of a
            transfer table (:mod:`bokehnet.lenses.lookup.transfer_file`) are looked up.
        focal_length: Effective focal length, mm, to which the whole lens is scaled. None keeps that of the
            design.
        f_number: F-number; None is fully open.
        focus_distance: Focus distance, mm from the entrance pupil.
        focusing: Definition of focus, as in :class:`PrescriptionLens`.
        copy_to_copy: Manufacturing errors as a multiple of the default
            :class:`bokehnet.lenses.assembly.tolerances.Tolerances`; 0 is the design.
        copy_seed: Seed of the copy.

    Raises:
        LensError: There is no such lens, or it cannot have this focus or f-number.
        ConfigError: The file is missing or invalid.
    """
    with errors_of_file(name, "a lens that can be traced", LensError):
        if Path(name).suffix.lower() == ".npz":
            if focal_length is not None:
                problem = "a transfer table has one focal length: make it from the scaled lens"
                raise LensError(f"{name}: {problem}")
            if copy_to_copy:
                raise LensError(f"{name}: a transfer table has no elements to misalign: use the lens itself")
            return dataclasses.replace(
                read_transfer(name), f_number=f_number, focus_distance=focus_distance, focusing=focusing
            )
        prescription = find_prescription(name)
        if focal_length is not None:
            if not 0 < focal_length < math.inf:
                raise LensError(f"need a focal length above 0, got {focal_length:g} mm")
            prescription = prescription.scaled(
                focal_length / PrescriptionLens(prescription=prescription).focal_length
            )
        if copy_to_copy:
            prescription = assemble_copy(prescription, Tolerances() * copy_to_copy, copy_seed)
        # The pupil moves with the groups.
        for _ in range(_FLOATING_ITERATIONS if prescription.floating else 0):
            front = PrescriptionLens(prescription=prescription).front_vertex
            prescription = prescription.focused(max(focus_distance - front, 1e-9))
        lens = functools.partial(
            PrescriptionLens,
            prescription=prescription,
            f_number=f_number,
            focus_distance=focus_distance,
            focusing=focusing,
        )
        if not is_lens_file(name):
            return lens()
        try:
            loaded = lens()
            _ = loaded.focus_shift  # raises if no ray passes, which is possible for files of other programs
        except LensError as error:
            raise LensError(f"{name}: {error}", error.parameter) from error
        return loaded

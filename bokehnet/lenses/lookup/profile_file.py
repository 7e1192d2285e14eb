"""File of a profile texture, with the lens that determines its rows."""

import dataclasses
import math
from pathlib import Path
from typing import IO

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.lookup.lens_archive import open_archive, write_archive
from bokehnet.lenses.lookup.profile_texture import ProfileTexture
from bokehnet.lenses.prescription import PrescriptionLens

__all__ = ["read_profile", "write_profile"]

_KIND = "lens profile texture 1"


def write_profile(texture: ProfileTexture, lens: PrescriptionLens, file: Path | IO[bytes]) -> None:
    """Write a texture and its lens, with focus and iris as set, as .npz."""
    arrays = {item.name: getattr(texture, item.name) for item in dataclasses.fields(ProfileTexture)}
    write_archive(
        file,
        _KIND,
        lens.prescription,
        f_number=math.nan if lens.f_number is None else lens.f_number,
        focus_distance=lens.focus_distance,
        focusing=lens.focusing,
        **arrays,
    )


def read_profile(path: str | Path) -> tuple[ProfileTexture, PrescriptionLens]:
    """Read a file of :func:`write_profile`.

    Raises:
        LensError: The file is missing or damaged, or contains other data.
    """
    with open_archive(path, _KIND, "profile texture") as (file, prescription):
        texture = ProfileTexture(
            planes=np.asarray(file["planes"], float),
            reach=np.asarray(file["reach"], float),
            light=np.asarray(file["light"], np.float32),
            image_gap=float(file["image_gap"]),
        )
        f_number, distance = float(file["f_number"]), float(file["focus_distance"])
        focusing = str(file["focusing"])
    problem = _problem(texture)
    if focusing not in ("sharpest", "paraxial"):
        problem = f"focusing: expected sharpest or paraxial, got {focusing[:60]!r}"
    if problem is not None:
        raise LensError(f"{path}: {problem}")
    return texture, PrescriptionLens(
        prescription=prescription,
        f_number=None if math.isnan(f_number) else f_number,
        focus_distance=distance,
        focusing="paraxial" if focusing == "paraxial" else "sharpest",
    )


def _problem(texture: ProfileTexture) -> str | None:
    """Return a description of the first invalid value, starting with its key, or None."""
    rows = len(texture.planes) if texture.planes.ndim == 1 else 0
    shape = texture.light.shape
    if rows < 2 or len(shape) != 2 or shape[0] != rows or shape[1] < 2 or texture.reach.shape != (rows,):
        sizes = f"{texture.planes.shape}, {texture.reach.shape} and {shape}"
        return f"planes, reach, light: expected rows of one number, two or more, got {sizes}"
    parts = (texture.planes, texture.reach, texture.light, np.array(texture.image_gap))
    if not all(bool(np.isfinite(part).all()) for part in parts):
        return "planes, reach, light, image_gap: expected finite numbers"
    if not (np.diff(texture.planes) > 0).all():
        return "planes: expected distances that rise"
    if not (texture.reach > 0).all() or (texture.light < 0).any():
        return "reach, light: expected radii above 0 and no negative light"
    return None

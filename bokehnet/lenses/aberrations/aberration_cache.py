"""Disk cache of aberration maps, so that each lens is traced once.

One file per lens and setting, in ``bokehnet`` under ``$XDG_CACHE_HOME`` or ``~/.cache``; files may be
deleted at any time. A damaged or foreign file is rewritten. If the cache is not writable, the lens is traced
each time.
"""

import contextlib
import dataclasses
import hashlib
import json
import os
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bokehnet.errors import BokehnetError
from bokehnet.lenses.aberrations.aberration_fit import WAVELENGTHS, fit_aberration_map
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.optics.aberrations.aberration_map import TERMS, AberrationMap

__all__ = ["cache_folder", "cached_aberration_map"]

# Increased whenever the fit or the file format changes.
_VERSION = 2
_ARRAYS = ("wavelengths", "transverse_aberration", "pupil_aberration", "vignetting_apertures")


def cached_aberration_map(
    lens: PrescriptionLens,
    *,
    half_diagonal: float | None = None,
    distortion: bool = False,
    wavelengths: Sequence[float] = WAVELENGTHS,
    folder: Path | None = None,
) -> AberrationMap:
    """Return :func:`fit_aberration_map` of a lens, from disk if cached.

    Args:
        lens: Lens to fit.
        half_diagonal: Half-diagonal of the picture, mm on the sensor; None is the image radius of the lens.
        distortion: Keep the distortion of the picture in the map.
        wavelengths: Wavelengths, nm.
        folder: Cache folder; None is :func:`cache_folder`.

    Raises:
        LensError: As :func:`fit_aberration_map`.
    """
    radius = lens.prescription.image_radius if half_diagonal is None else half_diagonal
    key = _key(lens, radius, distortion, wavelengths)
    folder = cache_folder() if folder is None else folder
    path = None if folder is None else folder / f"pencil-{hashlib.sha256(key.encode()).hexdigest()[:32]}.npz"
    cached = None if path is None else _read(path, key)
    if cached is not None:
        return cached
    aberration_map = fit_aberration_map(
        lens, half_diagonal=radius, distortion=distortion, wavelengths=wavelengths
    )
    if path is not None:
        with contextlib.suppress(OSError):
            _write(path, key, aberration_map)
    return aberration_map


def cache_folder() -> Path | None:
    """Return the cache folder; None if the user has no home folder. Ignores a relative ``$XDG_CACHE_HOME``.

    Source:
        Bastian et al., "XDG base directory specification", freedesktop.org, 2021.
    """
    xdg_cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if xdg_cache.is_absolute():
        return xdg_cache / "bokehnet"
    try:
        return Path.home() / ".cache" / "bokehnet"
    except RuntimeError:
        return None


def _key(lens: PrescriptionLens, half_diagonal: float, distortion: bool, wavelengths: Sequence[float]) -> str:
    """Return all inputs of a map as text."""
    return json.dumps(
        {
            "version": _VERSION,
            "terms": TERMS,
            "prescription": dataclasses.asdict(lens.prescription),
            "stop_radius": lens.stop_radius,
            "focus_distance": lens.focus_distance,
            "focusing": lens.focusing,
            "half_diagonal": half_diagonal,
            "distortion": distortion,
            "wavelengths": sorted(map(float, wavelengths)),
        },
        sort_keys=True,
    )


def _read(path: Path, key: str) -> AberrationMap | None:
    try:
        with np.load(path, allow_pickle=False) as file:
            if file["key"].item() != key:
                return None
            wavelengths, transverse_aberration, pupil_aberration, vignetting_apertures = (
                file[name] for name in _ARRAYS
            )
        pairs = tuple((float(shift), float(radius)) for shift, radius in vignetting_apertures)
        return AberrationMap(
            wavelengths=wavelengths,
            transverse_aberration=transverse_aberration,
            pupil_aberration=pupil_aberration,
            vignetting_apertures=pairs,
        )
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile, BokehnetError):
        return None


def _write(path: Path, key: str, aberration_map: AberrationMap) -> None:
    """Write a hidden file next to ``path``, then rename it atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=".pencil-", suffix=".npz", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(
                file,
                key=np.array(key),
                wavelengths=aberration_map.wavelengths,
                transverse_aberration=aberration_map.transverse_aberration,
                pupil_aberration=aberration_map.pupil_aberration,
                vignetting_apertures=np.array(aberration_map.vignetting_apertures, float).reshape(-1, 2),
            )
        os.replace(name, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise

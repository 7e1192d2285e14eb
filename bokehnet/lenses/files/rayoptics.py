"""ray-optics models, ``.roa``: rotationally symmetric lenses of spheres, conics and even aspheres.

Source: the output of ``rayoptics.optical.opticalmodel.OpticalModel.save_model``.
"""

import json
import math
from pathlib import Path
from typing import Any

from bokehnet.errors import LensError
from bokehnet.lenses.files.glass.glasses import GlassCatalogues
from bokehnet.lenses.files.glass.media import GlassEntry, medium_of
from bokehnet.lenses.files.structure import FileLens, FileSurface, fail
from bokehnet.lenses.files.text import read_lines
from bokehnet.optics.spectral.glass import FormulaGlass, Glass, TableGlass

__all__ = ["read_rayoptics"]

_UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inches": 25.4, "feet": 304.8}
_SHAPES = ("Spherical", "Conic", "EvenPolynomial", "RadialPolynomial")
_APERTURES = {
    ("object", "epd"): "epd",
    ("object", "pupil"): "epd",
    ("image", "f/#"): "working_f_number",
    ("object", "NA"): "object_na",
    ("image", "NA"): "image_na",
}


def read_rayoptics(path: Path, catalogues: GlassCatalogues) -> FileLens:
    """Read a ray-optics model.

    Raises:
        LensError: The file is not a model, or has surfaces other than spheres, conics or even aspheres about
            one axis.
    """
    try:
        data = json.loads("\n".join(read_lines(path)))
    except json.JSONDecodeError as error:
        fail(path, error.lineno, "JSON", error.msg)
    lens, key = FileLens(path=path), "optical_model"
    try:
        model = _attributes(data["optical_model"])
        system = _attributes(model["system_spec"])
        lens.name = str(system.get("title", ""))
        unit = str(system.get("_dimensions") or system.get("dimensions") or "mm").lower()
        lens.millimetres = _UNITS[unit]
        key = "seq_model"
        sequence = _attributes(model["seq_model"])
        profiles = model.get("profile_dict") or {}
        gaps = sequence["gaps"]
        for number, entry in enumerate(sequence["ifcs"]):
            key = f"ifcs[{number}]"
            gap: Any = _attributes(gaps[number]) if number < len(gaps) else {"thi": 0.0, "medium": None}
            surface = _surface(lens, key, entry, profiles)
            surface.thickness = float(gap["thi"])
            surface.medium = _medium(lens, f"gaps[{number}].medium", gap["medium"], catalogues)
            lens.surfaces.append(surface)
        stop = sequence.get("stop_surface")
        if stop is not None:
            lens.surfaces[stop].stop = True
        key = "optical_spec"
        _specification(lens, _attributes(model["optical_spec"]))
    except LensError:
        raise
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        fail(path, 0, key, f"expected the format of ray-optics, found no {error}")
    return lens


def _attributes(entry: Any) -> Any:
    """Return the attributes of a json-tricks object."""
    return entry.get("attributes", entry)


def _kind(entry: dict[str, Any]) -> str:
    return str(entry.get("__instance_type__", ["", ""])[1])


def _numbers(entry: Any) -> list[float]:
    return [float(number) for number in (entry["__ndarray__"] if isinstance(entry, dict) else entry)]


def _surface(lens: FileLens, key: str, entry: dict[str, Any], profiles: dict[str, Any]) -> FileSurface:
    if _kind(entry) not in ("Surface", ""):
        fail(lens.path, 0, key, f"expected a surface, got {_kind(entry)}, which has no shape")
    attributes = _attributes(entry)
    mode = attributes.get("interact_mode", "transmit")
    if mode not in ("transmit", "dummy", "reflect"):
        fail(lens.path, 0, key, f"expected a surface that refracts or reflects, got {mode}")
    if attributes.get("decenter") or attributes.get("phase_element"):
        fail(lens.path, 0, key, "expected refracting surfaces on one axis, got something else")
    profile = attributes.get("profile") or profiles.get(str(attributes.get("profile_id")))
    if profile is None:
        raise KeyError("profile")
    if _kind(profile) not in _SHAPES:
        fail(lens.path, 0, f"{key}.profile", f"expected one of {', '.join(_SHAPES)}, got {_kind(profile)}")
    shape = _attributes(profile)
    curvature = float(shape.get("cv", 0.0))
    powers = _numbers(shape.get("coefs", [])) if _kind(profile).endswith("Polynomial") else []
    odd: list[float] = []
    if _kind(profile) == "RadialPolynomial":
        if any(powers[:1]):
            fail(lens.path, 0, f"{key}.profile", "expected a surface without a tip, got a power of 1")
        powers, odd = powers[1::2], powers[2::2]
    size = attributes.get("max_aperture")
    return FileSurface(
        radius=1 / curvature if curvature else math.inf,
        conic=float(shape.get("cc", shape.get("ec", 1.0) - 1)),
        aspheric=tuple(powers),
        odd=tuple(odd),
        semi_diameter=float(size) if size else None,
        inner_radius=_obscuration_radius(attributes.get("clear_apertures") or []),
        mirror=mode == "reflect",
        comment=str(attributes.get("label") or ""),
    )


def _obscuration_radius(apertures: list[Any]) -> float:
    """Return the radius of the central obscuration, in the unit of the file."""
    shapes = [_attributes(aperture) for aperture in apertures]
    return max(
        (float(shape["radius"]) for shape in shapes if shape.get("is_obscuration") and "radius" in shape),
        default=0.0,
    )


def _medium(lens: FileLens, key: str, entry: Any, catalogues: GlassCatalogues) -> Glass | None:
    if not entry or _kind(entry) == "Air":
        return None
    attributes, kind = _attributes(entry), _kind(entry)
    name = str(
        attributes.get("gname") or attributes.get("label") or attributes.get("_label") or "model glass"
    )
    if kind in ("ConstantIndex",):
        return FormulaGlass(root=1.0, powers=((float(attributes["n"]), 0.0),))
    if kind in ("InterpolatedMedium", "InterpolatedGlass"):
        samples = sorted(zip(_numbers(attributes["wvls"]), _numbers(attributes["rndx"]), strict=True))
        return TableGlass(wavelengths=tuple(w for w, _ in samples), indices=tuple(n for _, n in samples))
    if kind == "ModelGlass" or "n" in attributes:
        nd, vd = float(attributes["n"]), float(attributes.get("v", 0.0))
        return medium_of(lens, GlassEntry(line=0, key=key, name=name, nd=nd, vd=vd), catalogues)
    maker = str(entry.get("__instance_type__", [""])[0]).rpartition(".")[2] or str(
        attributes.get("_catalog", "")
    )
    if kind == "SchottGlass" and len(attributes.get("coefs", [])) == 6:
        b1, b2, b3, c1, c2, c3 = _numbers(attributes["coefs"])
        poles = ((b1, 2.0, c1, 1.0), (b2, 2.0, c2, 1.0), (b3, 2.0, c3, 1.0))
        return FormulaGlass(powers=((1.0, 0.0),), poles=poles)
    return medium_of(lens, GlassEntry(line=0, key=key, name=name, maker=maker), catalogues)


def _specification(lens: FileLens, attributes: dict[str, Any]) -> None:
    pupil = _attributes(attributes["pupil"])
    key = pupil.get("key") or pupil.get("_key")
    kind = _APERTURES.get((key[-2], key[-1]))
    if kind is None:
        fail(lens.path, 0, "pupil", f"expected one of {list(_APERTURES)}, got {key}")
    lens.aperture = (kind, float(pupil["value"]))
    field = _attributes(attributes["field_of_view"])
    place, kind_of_field = (field.get("key") or field.get("_key"))[-2:]
    scale = abs(float(field.get("value", 1.0))) if field.get("is_relative") else 1.0
    sizes = [scale * math.hypot(_attributes(f)["x"], _attributes(f)["y"]) for f in field.get("fields", [])]
    lens.field = ("angle" if kind_of_field == "angle" else str(place), max(sizes, default=0.0))
    waves = _attributes(attributes["spectral_region"])
    lens.wavelength = float(waves["wavelengths"][int(waves.get("reference_wvl", 0))])

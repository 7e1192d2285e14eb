"""optiland JSON: rotationally symmetric lenses of spheres, conics and even aspheres.

Source: the output of ``optiland.fileio.save_optiland_file``, version 1.0.
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
from bokehnet.optics.spectral.glass import FormulaGlass, Glass

__all__ = ["read_optiland"]

_APERTURES = {"EPD": "epd", "imageFNO": "f_number", "objectNA": "object_na", "float_by_stop_size": "stop"}
_FIELDS = {
    "angle": "angle",
    "object_height": "object",
    "paraxial_image_height": "image",
    "real_image_height": "image",
}
_SHAPES = ("Plane", "StandardGeometry", "EvenAsphere")


def read_optiland(path: Path, catalogues: GlassCatalogues) -> FileLens:
    """Read a lens saved by optiland.

    Raises:
        LensError: The file is not such a lens, or has surfaces other than spheres, conics or even aspheres
            about one axis.
    """
    try:
        data = json.loads("\n".join(read_lines(path)))
    except json.JSONDecodeError as error:
        fail(path, error.lineno, "JSON", error.msg)
    if not (isinstance(data, dict) and "surface_group" in data):
        fail(path, 0, "surface_group", "expected surfaces, got none; is this a lens of optiland?")
    lens = FileLens(path=path, name=str(data.get("name") or ""))
    key = "surface_group"
    try:
        surfaces = data["surface_group"]["surfaces"]
        places = [float(surface["geometry"]["cs"]["z"]) for surface in surfaces]
        for number, surface in enumerate(surfaces):
            key = f"surfaces[{number}]"
            after = places[number + 1] if number + 1 < len(surfaces) else places[number]
            lens.surfaces.append(_surface(lens, key, surface, after - places[number], catalogues))
            if lens.surfaces[-1].mirror:
                lens.surfaces[-1].medium = lens.surfaces[-2].medium
        key = "aperture"
        aperture = data["aperture"]
        lens.aperture = (_APERTURES.get(aperture["type"], ""), float(aperture["value"]))
        if not lens.aperture[0]:
            fail(path, 0, key, f"expected one of {', '.join(_APERTURES)}, got {aperture['type']}")
        if lens.aperture[0] == "stop":
            stop = next(surface for surface in lens.surfaces if surface.stop)
            stop.semi_diameter = lens.aperture[1] / 2
        key = "fields"
        fields = data["fields"]["fields"]
        kind = data["fields"].get("field_type") or (fields[0].get("field_type") if fields else "angle")
        if isinstance(kind, dict):
            kind = kind.get("field_type", "angle")
        sizes = [math.hypot(float(entry["x"]), float(entry["y"])) for entry in fields]
        lens.field = (_FIELDS.get(str(kind), "angle"), max(sizes, default=0.0))
        key = "wavelengths"
        waves = data["wavelengths"]["wavelengths"]
        primary = next((wave for wave in waves if wave.get("is_primary")), waves[0])
        lens.wavelength = (
            float(primary["value"]) * {"um": 1e3, "nm": 1.0, "mm": 1e6}[primary.get("unit", "um")]
        )
    except LensError:
        raise
    except (KeyError, TypeError, ValueError, IndexError, StopIteration) as error:
        fail(path, 0, key, f"expected the format of optiland, found no {error}")
    return lens


def _surface(
    lens: FileLens, key: str, surface: dict[str, Any], thickness: float, catalogues: GlassCatalogues
) -> FileSurface:
    geometry = surface["geometry"]
    shape, place = geometry["type"], geometry["cs"]
    if shape not in _SHAPES:
        fail(lens.path, 0, f"{key}.geometry", f"expected one of {', '.join(_SHAPES)}, got {shape}")
    if any(float(place.get(offset, 0.0)) != 0 for offset in ("x", "y", "rx", "ry")):
        fail(lens.path, 0, f"{key}.cs", "expected surfaces about one axis, got a shift or a tilt")
    if surface.get("surface_type") == "paraxial" or surface.get("type") == "ParaxialSurface":
        fail(lens.path, 0, key, "expected glass, got a paraxial lens")
    mirror = bool(surface.get("is_reflective") or surface.get("interaction_model", {}).get("is_reflective"))
    radius = float(geometry.get("radius", math.inf))
    powers = (
        tuple(float(power) for power in geometry.get("coefficients", ())) if shape == "EvenAsphere" else ()
    )
    medium = None  # behind a mirror, the one in front
    if not mirror:
        medium = _medium(lens, f"{key}.material_post", surface["material_post"], catalogues)
    aperture = surface.get("aperture") or {}
    outer = aperture.get("r_max") if isinstance(aperture, dict) else None
    return FileSurface(
        radius=radius,
        thickness=thickness,
        conic=float(geometry.get("conic", 0.0) or 0.0),
        aspheric=powers,
        medium=medium,
        mirror=mirror,
        semi_diameter=None if outer is None else float(outer),
        inner_radius=float(aperture.get("r_min") or 0.0) if isinstance(aperture, dict) else 0.0,
        stop=bool(surface.get("is_stop", False)),
        comment=str(surface.get("comment") or ""),
    )


def _medium(lens: FileLens, key: str, material: dict[str, Any], catalogues: GlassCatalogues) -> Glass | None:
    kind = material.get("type")
    if kind == "IdealMaterial":
        index = material["index"]
        index = float(index[0] if isinstance(index, list) else index)
        return None if index == 1 else FormulaGlass(root=1.0, powers=((index, 0.0),))
    if kind == "AbbeMaterial":
        nd, vd = float(material["index"]), float(material["abbe"])
        return medium_of(lens, GlassEntry(line=0, key=key, name="model glass", nd=nd, vd=vd), catalogues)
    name = str(material.get("name", kind))
    folder = str(material.get("filename", "")).replace("\\", "/").split("/")
    maker = str(material.get("reference") or (folder[-2] if len(folder) > 1 else ""))
    return medium_of(lens, GlassEntry(line=0, key=key, name=name, maker=maker), catalogues)

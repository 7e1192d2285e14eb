"""Tables of scene files in TOML.

Positions and sizes are in metres, x to the right, y down, z along the optical axis from the lens; focal
length and sensor are in millimetres. File names are relative to the scene file. See ``configs/scene_*.toml``.
"""

import math
from dataclasses import dataclass, field

from bokehnet.raytrace.scene import Vector
from bokehnet.raytrace.surfaces.materials import Color

__all__ = [
    "BackgroundTable",
    "CameraTable",
    "EnvironmentTable",
    "LampTable",
    "LensTable",
    "MaterialTable",
    "MeshTable",
    "QuadTable",
    "RenderTable",
    "SceneTable",
    "SphereTable",
]

_BLACK: Color = (0.0, 0.0, 0.0)
_ORIGIN: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class CameraTable:
    """Sensor and exposure.

    Attributes:
        width: Width, pixels.
        height: Height, pixels.
        sensor_width: Sensor width, mm.
        shutter: Exposure time, s.
        tilt: Tilt of the sensor about x and about y, degrees: positive values move its lower side, and its
            left side, away from the lens, so that the upper side of the picture, and its right side, focuses
            nearer.
        shift: Shift of the sensor centre (x, y), mm: to the right and down, which shows more of the left and
            of the upper side of the scene.
        focus_points: Three points of the scene, m; replaces ``tilt`` by the tilt that brings their plane into
            focus.
    """

    width: int
    height: int
    sensor_width: float = 36.0
    shutter: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)
    shift: tuple[float, float] = (0.0, 0.0)
    focus_points: tuple[Vector, Vector, Vector] | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class LensTable:
    """Lens: thin, one of the catalog (:mod:`bokehnet.lenses.catalog`), or a prescription file.

    Attributes:
        name: ``thin``, a catalog name, or the path of a lens file or transfer table.
        focal_length: Focal length, mm; required for a thin lens; others are scaled to it.
        f_number: F-number; required for a thin lens; default of others: fully open.
        focus_distance: Focus distance from the entrance pupil, m.
    """

    name: str = "thin"
    focal_length: float | None = None
    f_number: float | None = None
    focus_distance: float = math.inf


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderTable:
    """Settings of the tracer.

    Attributes:
        samples: Samples per pixel, or views of an accumulation.
        seed: Seed of the samples.
        bounces: Maximum number of scattering events.
        dispersion: True if each ray has a single wavelength.
        method: ``distribution`` or ``accumulation``, see :class:`bokehnet.raytrace.tracer.Tracer`.
        adaptive: True if pixels with larger variance receive more samples; ``samples`` is then the mean.
    """

    samples: int = 256
    seed: int = 0
    bounces: int = 2
    dispersion: bool = False
    method: str = "distribution"
    adaptive: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class EnvironmentTable:
    """Environment light: a colour, times a latitude-longitude map."""

    color: Color = _BLACK
    texture: str | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class BackgroundTable:
    """Picture that fills the frame behind all bodies and lights nothing; its depth is in m."""

    color: Color = (1.0, 1.0, 1.0)
    texture: str | None = None
    depth: float = math.inf


@dataclass(frozen=True, kw_only=True, slots=True)
class MaterialTable:
    """See :class:`~bokehnet.raytrace.surfaces.materials.Material`; the texture may have alpha."""

    color: Color = _BLACK
    specular: Color = _BLACK
    translucency: Color = _BLACK
    roughness: float = 0.1
    emission: Color = _BLACK
    texture: str | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class QuadTable:
    """Parallelogram ``centre + a * u_axis + b * v_axis``, a and b from -1 to 1; velocity in m/s."""

    centre: Vector
    u_axis: Vector
    v_axis: Vector
    material: MaterialTable
    velocity: Vector = _ORIGIN
    name: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class SphereTable:
    """Sphere; lengths in m, velocity in m/s."""

    centre: Vector
    radius: float
    material: MaterialTable
    velocity: Vector = _ORIGIN
    name: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class MeshTable:
    """Mesh from a file with y up: scaled, rotated about x, y and z in degrees, then translated.

    Attributes:
        file: OBJ, PLY, STL or glTF file.
        material: Material.
        scale: Metres per unit of the file.
        size: Longest side of the bounding box, m, with its middle at ``centre``; replaces ``scale``. None
            has the origin of the file at ``centre``.
        rotation: Rotation, degrees.
        centre: Position, m.
        smooth: True for smooth shading.
        velocity: Velocity, m/s.
        name: Name for messages and maps.
    """

    file: str
    material: MaterialTable
    scale: float = 1.0
    size: float | None = None
    rotation: Vector = _ORIGIN
    centre: Vector = _ORIGIN
    smooth: bool = False
    velocity: Vector = _ORIGIN
    name: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class LampTable:
    """Point light; irradiance is intensity / (distance in m)^2."""

    position: Vector
    intensity: Color


@dataclass(frozen=True, kw_only=True, slots=True)
class SceneTable:
    """Content of a scene file."""

    camera: CameraTable
    lens: LensTable
    render: RenderTable = field(default_factory=RenderTable)
    environment: EnvironmentTable = field(default_factory=EnvironmentTable)
    background: BackgroundTable | None = None
    quads: tuple[QuadTable, ...] = ()
    spheres: tuple[SphereTable, ...] = ()
    meshes: tuple[MeshTable, ...] = ()
    lamps: tuple[LampTable, ...] = ()

"""Scenes from TOML files.

Places and sizes are in metres, x to the right, y down, z along the optical axis from the lens; focal
length and sensor are in millimetres. Files are named relative to the scene file. See
``configs/scene_*.toml``.
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
    """The sensor, and how long it sees.

    Attributes:
        width: Pixels.
        height: Pixels.
        sensor_width: mm.
        shutter: For how many seconds it is open.
        tilt: Of the sensor, about x and about y, degrees: above 0 its lower side, and its left side, moves
            away from the lens, so that the upper side of the picture, and its right, focuses nearer.
        shift: Of the sensor's middle, (x, y), mm: to the right and down, which shows more of the left and
            of the upper side of the scene.
        focus_points: Three points of the scene, m; the sensor is tilted so that the plane through them is
            sharp. In place of ``tilt``.
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
    """A lens: thin, one of the catalog (:mod:`bokehnet.lenses.catalog`), or a prescription file.

    Attributes:
        name: ``thin``, a name of the catalog, or the path of a lens file or of a transfer table.
        focal_length: mm; a thin lens needs it, others are scaled to it.
        f_number: A thin lens needs it; others are fully open without.
        focus_distance: m from the entrance pupil.
    """

    name: str = "thin"
    focal_length: float | None = None
    f_number: float | None = None
    focus_distance: float = math.inf


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderTable:
    """How rays are sent.

    Attributes:
        samples: Of each pixel; the views of an accumulation.
        seed: Of their noise.
        bounces: How often light is scattered.
        dispersion: Whether each ray has one wavelength.
        method: ``distribution`` or ``accumulation``, see :class:`bokehnet.raytrace.tracer.Tracer`.
        adaptive: Whether pixels get the more samples the more theirs differ; ``samples`` is then the mean.
    """

    samples: int = 256
    seed: int = 0
    bounces: int = 2
    dispersion: bool = False
    method: str = "distribution"
    adaptive: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class EnvironmentTable:
    """Light from all around: a colour, times a map of longitude and latitude."""

    color: Color = _BLACK
    texture: str | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class BackgroundTable:
    """A picture that fills the frame behind everything and lights nothing; its depth is in m."""

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
    """The parallelogram ``centre + a * u_axis + b * v_axis``, a and b from -1 to 1; velocity in m/s."""

    centre: Vector
    u_axis: Vector
    v_axis: Vector
    material: MaterialTable
    velocity: Vector = _ORIGIN
    name: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class SphereTable:
    """A sphere."""

    centre: Vector
    radius: float
    material: MaterialTable
    velocity: Vector = _ORIGIN
    name: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class MeshTable:
    """A mesh from a file whose y axis points up: scaled, turned about x, y and z in degrees, then moved."""

    file: str
    material: MaterialTable
    scale: float = 1.0
    rotation: Vector = _ORIGIN
    centre: Vector = _ORIGIN
    smooth: bool = False
    velocity: Vector = _ORIGIN
    name: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class LampTable:
    """A light without size; irradiance is intensity / (distance in m)^2."""

    position: Vector
    intensity: Color


@dataclass(frozen=True, kw_only=True, slots=True)
class SceneTable:
    """All that a scene file may say."""

    camera: CameraTable
    lens: LensTable
    render: RenderTable = field(default_factory=RenderTable)
    environment: EnvironmentTable = field(default_factory=EnvironmentTable)
    background: BackgroundTable | None = None
    quads: tuple[QuadTable, ...] = ()
    spheres: tuple[SphereTable, ...] = ()
    meshes: tuple[MeshTable, ...] = ()
    lamps: tuple[LampTable, ...] = ()

"""Reader of scene files into worlds and cameras."""

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bokehnet.checks import check_above, check_at_least, check_choice, check_number, check_numbers
from bokehnet.config import dump_json, load_config
from bokehnet.errors import (
    ConfigError,
    DataFileError,
    ImageFileError,
    LensError,
    ParameterError,
    ShapeError,
)
from bokehnet.io.image import read_image
from bokehnet.io.pixels import ImageFile
from bokehnet.lenses import LensModel, PrescriptionLens, ThickLens, ThinLens, TiltShift, load_lens
from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.geometry.meshes import Mesh, read_mesh
from bokehnet.raytrace.geometry.quads import Quad
from bokehnet.raytrace.geometry.spheres import Sphere
from bokehnet.raytrace.scene import Background, Vector, plane_texture
from bokehnet.raytrace.surfaces.lights import Environment, PointLight
from bokehnet.raytrace.surfaces.materials import Material
from bokehnet.raytrace.tracer import METHODS, Tracer, lens_rays
from bokehnet.raytrace.world import Body, World
from bokehnet.scenes.sensor_depth import depth_along_sensor
from bokehnet.scenes.tables import (
    BackgroundTable,
    CameraTable,
    LensTable,
    MaterialTable,
    MeshTable,
    RenderTable,
    SceneTable,
)

__all__ = ["SceneJob", "read_camera", "read_scene", "read_scene_table"]

_MM_PER_M = 1000.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneJob:
    """Scene ready for tracing.

    Attributes:
        world: World to trace.
        camera: Camera.
        shutter: Exposure time, s.
        render: Settings of the tracer.
        digest: Digest of everything that determines the picture, except the number of samples.
    """

    world: World
    camera: Camera
    shutter: float
    render: RenderTable
    digest: str

    def sensor_depth(self, depth: Tensor) -> Tensor:
        """Return depths (H, W, ...), mm, along the lens axis as depths along the sensor normal."""
        return depth_along_sensor(self.camera, depth)

    def tracer(self, device: torch.device | str = "cpu", rows: tuple[int, int] | None = None) -> Tracer:
        """Return the tracer of the scene file, for all rows or a range."""
        return Tracer(
            self.world,
            self.camera,
            seed=self.render.seed,
            bounces=self.render.bounces,
            shutter=self.shutter,
            dispersion=self.render.dispersion,
            device=device,
            method=self.render.method,
            rows=rows,
        )


def read_scene(
    path: Path | str, overrides: Mapping[str, Any] | None = None, device: torch.device | str = "cpu"
) -> SceneJob:
    """Read a scene file and all files that it names.

    Args:
        path: TOML file; see :mod:`bokehnet.scenes.tables`.
        overrides: Values that override those of the file, such as ``{"camera.width": 64}``.
        device: Device of the textures.

    Raises:
        ConfigError: Anything in the scene is wrong; names file and key.
        MissingExtraError: The scene has meshes, and trimesh or Embree is not installed.
    """
    path = Path(path)
    return read_scene_table(path, load_config(path, SceneTable, overrides), device)


def read_scene_table(path: Path, table: SceneTable, device: torch.device | str = "cpu") -> SceneJob:
    """Return the scene of a table; see :func:`read_scene`.

    Args:
        path: Scene file; file names are relative to its folder.
        table: Its content.
        device: Device of the textures.
    """
    return _Reader(path, table, torch.device(device)).read()


def read_camera(path: Path | str, table: SceneTable, *, ideal: bool = False) -> Camera:
    """Return the camera of a table; the lens file that it names, if any, is relative to the scene file.

    Args:
        path: Scene file.
        table: Its content, or a changed one.
        ideal: True for a lens without aberrations, with the focal length, focus and pupils of the real one.

    Raises:
        ConfigError: Camera or lens are wrong.
    """
    return _Reader(Path(path), table, torch.device("cpu")).camera(ideal)


class _Reader:
    """Reader of one file; includes the files that it names in the digest."""

    def __init__(self, path: Path, table: SceneTable, device: torch.device) -> None:
        self._path, self._table, self._device = path, table, device
        self._digest = hashlib.sha256(
            dump_json(replace(table, render=replace(table.render, samples=0))).encode()
        )

    def read(self) -> SceneJob:
        camera = self.camera()
        table = self._table
        with self._errors_prefixed("environment"):
            texture = self._picture("environment.texture", table.environment.texture)[:3]
            environment = Environment(texture=texture * self._color(table.environment.color))
        with self._errors_prefixed("background"):
            backdrop = None if table.background is None else self._backdrop(table.background, camera)
        bodies: list[Body] = []
        for index, quad in enumerate(table.quads):
            key = f"quads[{index}]"
            with self._errors_prefixed(key):
                shape = Quad(
                    centre=_mm("centre", quad.centre),
                    u_axis=_mm("u_axis", quad.u_axis),
                    v_axis=_mm("v_axis", quad.v_axis),
                )
            bodies.append(self._body(key, shape, quad.material, quad.velocity, quad.name))
        for index, sphere_table in enumerate(table.spheres):
            key = f"spheres[{index}]"
            with self._errors_prefixed(key):
                check_number("radius", sphere_table.radius)
                sphere = Sphere(
                    centre=_mm("centre", sphere_table.centre), radius=sphere_table.radius * _MM_PER_M
                )
            bodies.append(
                self._body(key, sphere, sphere_table.material, sphere_table.velocity, sphere_table.name)
            )
        for index, mesh_table in enumerate(table.meshes):
            key = f"meshes[{index}]"
            mesh = self._mesh(key, mesh_table)
            bodies.append(self._body(key, mesh, mesh_table.material, mesh_table.velocity, mesh_table.name))
        lamps = []
        for index, lamp_table in enumerate(table.lamps):
            with self._errors_prefixed(f"lamps[{index}]"):
                red, green, blue = (value * _MM_PER_M**2 for value in lamp_table.intensity)
                lamps.append(
                    PointLight(position=_mm("position", lamp_table.position), intensity=(red, green, blue))
                )
        world = World(bodies=tuple(bodies), lamps=tuple(lamps), environment=environment, backdrop=backdrop)
        with self._errors_prefixed("camera"):
            check_at_least("shutter", table.camera.shutter, 0)
        with self._errors_prefixed("render"):
            check_at_least("samples", table.render.samples, 1)
            check_at_least("bounces", table.render.bounces, 0)
            check_choice("method", table.render.method, METHODS)
            if table.render.adaptive and table.render.method != "distribution":
                raise ParameterError("adaptive", "method 'distribution'", shown=f"'{table.render.method}'")
        return SceneJob(
            world=world,
            camera=camera,
            shutter=table.camera.shutter,
            render=table.render,
            digest=self._digest.hexdigest(),
        )

    @contextmanager
    def _errors_prefixed(self, key: str) -> Iterator[None]:
        """Prefix errors with file and key."""
        try:
            yield
        except ConfigError:
            raise
        except (DataFileError, ImageFileError, LensError, ParameterError, ShapeError) as error:
            raise ConfigError(f"{self._path}: {key}: {error}") from error

    def camera(self, ideal: bool = False) -> Camera:
        """Return the camera, with its lens, tilt and shift; see :func:`read_camera`."""
        table = self._table.camera
        with self._errors_prefixed("camera"):
            check_above("sensor_width", table.sensor_width, 0, "mm")
            lens: ThinLens | ThickLens | PrescriptionLens = self._lens(self._table.lens)
            if ideal and isinstance(lens, PrescriptionLens):
                lens = lens.thick
            camera = Camera(
                lens=self._with_tilt_shift(lens, table),
                width=table.width,
                height=table.height,
                pixel_pitch=table.sensor_width / max(table.width, 1),
            )
        if not ideal:
            with self._errors_prefixed("lens"):
                _check_transmission(camera)
        return camera

    def _with_tilt_shift(
        self, lens: ThinLens | ThickLens | PrescriptionLens, table: CameraTable
    ) -> LensModel:
        """Return the lens with a tilted and shifted sensor, if the table has tilt or shift."""
        if table.focus_points is not None:
            if any(table.tilt):
                expected = "either these or `tilt`"
                raise ParameterError("focus_points", expected, shown="both", remedy="leave one of them out")
            with self._errors_prefixed("camera.focus_points"):
                points = np.array([_mm("point", point) for point in table.focus_points])
                return TiltShift.focused_on(lens, points, table.shift)
        if not (any(table.tilt) or any(table.shift)):
            return lens
        with self._errors_prefixed("camera"):
            return TiltShift(lens=lens, tilt=table.tilt, shift=table.shift)

    def _lens(self, table: LensTable) -> ThinLens | PrescriptionLens:
        with self._errors_prefixed("lens"):
            lens = self._thin(table) if table.name == "thin" else self._glass(table)
        with self._errors_prefixed("lens.focus_distance"):
            return replace(lens, focus_distance=table.focus_distance * _MM_PER_M)

    def _thin(self, table: LensTable) -> ThinLens | PrescriptionLens:
        if table.focal_length is None or table.f_number is None:
            missing = "focal_length" if table.focal_length is None else "f_number"
            expected = "`focal_length` and `f_number` for a thin lens"
            raise ParameterError(missing, expected, None, shown="none", remedy="give both, or `name` a lens")
        return ThinLens(focal_length=table.focal_length, f_number=table.f_number)

    def _glass(self, table: LensTable) -> PrescriptionLens:
        file = self._path.parent / table.name
        if file.is_file():
            self._digest.update(file.read_bytes())
        name = file if file.is_file() else table.name
        return load_lens(name, focal_length=table.focal_length, f_number=table.f_number)

    def _backdrop(self, table: BackgroundTable, camera: Camera) -> Background:
        if not table.depth > 0:
            raise ParameterError("depth", "more than 0 m", table.depth)
        corners = torch.tensor([[1, 1], [-1, 1], [1, -1], [-1, -1]])
        corners = corners * torch.tensor([camera.width, camera.height]) * camera.pixel_pitch / 2
        slope = camera.lens.sample_rays(corners, torch.zeros_like(corners)).slope.abs().amax(0)
        texture = self._picture("background.texture", table.texture)[:3] * self._color(table.color)
        return Background(
            texture=texture,
            half_extent=(float(slope[0]), float(slope[1])),
            disparity=1 / (table.depth * _MM_PER_M),
        )

    def _body(
        self, key: str, shape: Quad | Sphere | Mesh, table: MaterialTable, velocity: Vector, name: str
    ) -> Body:
        with self._errors_prefixed(f"{key}.material"):
            material = Material(
                color=table.color,
                specular=table.specular,
                translucency=table.translucency,
                roughness=table.roughness,
                emission=table.emission,
                texture=self._picture(f"{key}.material.texture", table.texture),
            )
        if not (material.reflects or any(material.emission)):
            raise ConfigError(
                f"{self._path}: {key}.material: expected a color, specular, translucency or emission above 0"
            )
        with self._errors_prefixed(key):
            return Body(shape=shape, material=material, velocity=_mm("velocity", velocity), name=name or key)

    def _mesh(self, key: str, table: MeshTable) -> Mesh:
        file = self._path.parent / table.file
        with self._errors_prefixed(key):
            check_above("scale", table.scale, 0)
            check_numbers("rotation", table.rotation, 3)
            centre, size = _mm("centre", table.centre), None
            if table.size is not None:
                check_above("size", table.size, 0, "m")
                size = table.size * _MM_PER_M
        with self._errors_prefixed(f"{key}.file"):
            mesh = read_mesh(
                file,
                smooth=table.smooth,
                scale=table.scale * _MM_PER_M,
                rotation=table.rotation,
                centre=centre,
                size=size,
            )
        self._digest.update(file.read_bytes())
        return mesh

    def _picture(self, key: str, name: str | None) -> Tensor:
        """Return premultiplied RGB and alpha, (4, H, W); one white texel without a file."""
        if name is None:
            return torch.ones(4, 1, 1, device=self._device)
        file = self._path.parent / name
        with self._errors_prefixed(key):
            light = read_image(file)
            with ImageFile(file) as opened:
                part = opened.parts[0]
                alpha = opened.read(part, [part.alpha])[..., 0] if part.alpha else np.ones(light.shape[:2])
        self._digest.update(file.read_bytes())
        texture = plane_texture(light)
        texture[3] = torch.from_numpy(alpha)
        return texture.to(self._device)

    def _color(self, color: Vector) -> Tensor:
        for value in color:
            if not value >= 0:
                raise ParameterError("color", "at least 0", value)
        return torch.tensor(color, device=self._device).reshape(3, 1, 1)


def _mm(name: str, vector: Vector) -> Vector:
    """Return a vector in m as mm; raises ``ParameterError`` unless it is finite."""
    check_numbers(name, vector, 3)
    x, y, z = (value * _MM_PER_M for value in vector)
    return x, y, z


def _check_transmission(camera: Camera) -> None:
    """Raise ``LensError`` unless some light passes the lens to the picture centre."""
    side = torch.linspace(-0.7, 0.7, 15)
    pupil = torch.stack(torch.meshgrid(side, side, indexing="ij"), -1).reshape(-1, 2)
    _, weight = lens_rays(camera, torch.zeros_like(pupil), pupil, torch.zeros(len(pupil)))
    if not bool((weight > 0).any()):
        raise LensError("no light passes the lens to the picture centre")

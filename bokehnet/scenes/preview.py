"""Preview of a scene file: an orbiting camera, drafts for motion, and pictures that converge to the trace.

Source: thesis 001, appendix B, the previewer of BokehLab, which rotates a scene, refocuses and accumulates.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
import torch

from bokehnet.checks import check_at_least, check_number, check_range
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.config import load_config
from bokehnet.lenses import catalog_names
from bokehnet.raytrace.camera import Camera, Pose
from bokehnet.raytrace.draft import draft_light
from bokehnet.raytrace.threads import one_torch_thread
from bokehnet.raytrace.tracer import Tracer, lens_rays
from bokehnet.scenes.mesh_scene import mesh_scene
from bokehnet.scenes.reader import read_camera, read_scene_table
from bokehnet.scenes.tables import LensTable, SceneTable

__all__ = ["ScenePreview", "View"]

_MM_PER_M = 1000.0

# Distance of the pivot without a surface in the middle of the picture or a finite focus, m.
_FALLBACK_PIVOT = 2.0

# Maximum blur radius of a draft, as a fraction of the picture's width.
_MAX_DRAFT_BLUR = 0.15

# Cameras that are kept: real and ideal lens, at the sizes of motion and of rest.
_CACHED_CAMERAS = 8

# Samples between two refined pictures: the first, and the largest.
_FIRST_SAMPLES, _MAX_SAMPLES = 4, 32


@dataclass(frozen=True, kw_only=True)
class View:
    """Camera of a preview, relative to that of the scene file.

    Attributes:
        lens: Lens and focus.
        azimuth: Turn around the vertical axis through the pivot, degrees; positive moves to the right.
        elevation: Turn upwards, degrees, -89 to 89.
        zoom: Distance of the camera from the pivot, relative to the scene file's.
        width: Width of the picture, pixels; the height keeps the proportions of the scene file.

    Raises:
        ParameterError: A number is outside its range.
    """

    lens: LensTable
    azimuth: float = 0.0
    elevation: float = 0.0
    zoom: float = 1.0
    width: int = 320

    def __post_init__(self) -> None:
        check_number("azimuth", self.azimuth)
        check_range("elevation", self.elevation, -89, 89, "degrees")
        check_range("zoom", self.zoom, 0.05, 20)
        check_at_least("width", self.width, 16)


class ScenePreview:
    """Scene file opened for a preview.

    Args:
        path: Scene file, TOML; see :mod:`bokehnet.scenes.tables`. Or a mesh file; see :func:`mesh_scene`.

    Raises:
        ConfigError: Anything in the scene is wrong.
        MissingExtraError: The scene has meshes, and trimesh or Embree is not installed.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        is_mesh = self.path.suffix.lower() != ".toml"
        self._table = mesh_scene(self.path) if is_mesh else load_config(self.path, SceneTable)
        self._job = read_scene_table(self.path, self._table)
        self._camera_of = lru_cache(_CACHED_CAMERAS)(self._make_camera)
        self._pivot = self._pivot_distance()

    @property
    def lens(self) -> LensTable:
        """Lens of the scene file."""
        return self._table.lens

    @cached_property
    def lenses(self) -> list[str]:
        """Names of lenses to choose from: the scene's own, thin, and the catalog's."""
        return list(dict.fromkeys([self._table.lens.name, "thin", *catalog_names(mirrors=False)]))

    @property
    def samples(self) -> int:
        """Samples per pixel of a converged picture."""
        return self._job.render.samples

    @property
    def ratio(self) -> float:
        """Height over width."""
        return self._table.camera.height / self._table.camera.width

    def draft(self, view: View) -> np.ndarray:
        """Return a picture without noise: direct light, blurred as a scatter by its depth, (H, W, 3).

        The lens is ideal: a real one needs its effective pupil, a second after each change of the focus.
        """
        camera = self._camera(view, ideal=True)
        with one_torch_thread():
            light, depth = self._pinhole(camera)
        defocus = np.asarray(camera.lens.coc_radius(1 / depth) / camera.pixel_pitch, np.float32)
        limit = _MAX_DRAFT_BLUR * camera.width
        return np.asarray(scatter(light, np.clip(np.nan_to_num(defocus), -limit, limit)))

    def refine(self, view: View, cancelled: Callable[[], bool]) -> Iterator[tuple[np.ndarray, int]]:
        """Yield traced pictures (H, W, 3) that converge, and their numbers of samples.

        Args:
            view: Camera.
            cancelled: Function that ends the iteration at the next block of rays when it returns True.
        """
        camera = self._camera(view, ideal=False)
        tracer = Tracer(
            self._job.world,
            camera,
            seed=self._job.render.seed,
            bounces=self._job.render.bounces,
            shutter=self._job.shutter,
            dispersion=self._job.render.dispersion,
        )
        total = torch.zeros(camera.width * camera.height, 3)
        done, step = 0, _FIRST_SAMPLES
        while done < self.samples:
            stop = min(done + step, self.samples)
            for sample in range(done, stop):  # one sample a block, so that a cancellation is quick
                for pixels, colors in tracer.trace_bokeh(sample, 1):
                    if cancelled():
                        return
                    total[pixels] += colors
            done, step = stop, min(2 * step, _MAX_SAMPLES)
            yield (total / done).reshape(camera.height, camera.width, 3).numpy(), done

    def focus_at(self, view: View, x: float, y: float) -> float:
        """Return the depth, m, of the surface at a point, fractions of the picture; inf without one."""
        with one_torch_thread():
            depth = self._pinhole(self._camera(view, ideal=True))[1]
        row, column = (
            min(max(int(part * size), 0), size - 1) for part, size in zip((y, x), depth.shape, strict=True)
        )
        return float(depth[row, column]) / _MM_PER_M

    def _make_camera(self, lens: LensTable, width: int, ideal: bool) -> Camera:
        """Return the camera of the scene file with another lens and size."""
        size = replace(self._table.camera, width=width, height=max(1, round(width * self.ratio)))
        return read_camera(self.path, replace(self._table, lens=lens, camera=size), ideal=ideal)

    def _camera(self, view: View, ideal: bool) -> Camera:
        """Return the camera of a view: the file's, moved on a sphere about the pivot."""
        camera = self._camera_of(view.lens, view.width, ideal)
        if not (view.azimuth or view.elevation or view.zoom != 1):
            return camera
        turn, rise = math.radians(view.azimuth), math.radians(view.elevation)
        # The camera moves to the right and up (-y), and looks at the pivot.
        about_y = np.array(
            [[math.cos(turn), 0, -math.sin(turn)], [0, 1, 0], [math.sin(turn), 0, math.cos(turn)]]
        )
        about_x = np.array(
            [[1, 0, 0], [0, math.cos(rise), math.sin(rise)], [0, -math.sin(rise), math.cos(rise)]]
        )
        rotation = about_y @ about_x
        pivot = np.array([0, 0, self._pivot])
        position = pivot - rotation @ (view.zoom * pivot)
        rows = [(float(a), float(b), float(c)) for a, b, c in rotation]
        x, y, z = (float(value) for value in position)
        return replace(camera, pose=Pose(rotation=(rows[0], rows[1], rows[2]), position=(x, y, z)))

    def _pinhole(self, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """Return draft light (H, W, 3) and depth (H, W), mm, through the middle of the pupil."""
        sensor = camera.sensor_xy(torch.device("cpu"), torch.float32).reshape(-1, 2)
        rays, _ = lens_rays(camera, sensor, torch.zeros_like(sensor), torch.zeros(len(sensor)))
        light, depth = draft_light(self._job.world, rays)
        size = (camera.height, camera.width)
        return light.reshape(*size, 3).numpy(), depth.reshape(size).numpy()

    def _pivot_distance(self) -> float:
        """Return the depth of the pivot, mm: the focus, or the surface in the middle of the picture."""
        focus = self._table.lens.focus_distance
        if math.isinf(focus):
            depth = self._pinhole(replace(self._job.camera, width=1, height=1))[1]
            focus = float(depth[0, 0]) / _MM_PER_M
        return (focus if math.isfinite(focus) else _FALLBACK_PIVOT) * _MM_PER_M

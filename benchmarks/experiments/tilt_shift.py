"""Leaning planes of focus against the ray tracer's tilted sensor.

``python -m benchmarks.experiments.tilt_shift`` traces walls of noise with a tilted sensor, finds the line of
best focus from how sharp the traced pictures are, and says how far it is from where the defocus map of
``bokehnet render`` is 0. Beside it: PSNR of rendered pictures against the traced ones, away from the border.
"""

import argparse
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch

import bokehnet
from bokehnet.baselines.rays.image_space_slices import image_space
from bokehnet.classical.rays_renderer import rays
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.io.image import write_image
from bokehnet.lenses import ThinLens, TiltShift
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.raytrace import Body, Camera, Material, Quad, Tracer, World, plane_texture
from bokehnet.raytrace.surfaces.textures import fractal_noise
from bokehnet.scene.depth.depth_source import MetricDepth
from bokehnet.scene.focus import FocusedLens, focus_lens
from bokehnet.scene.scene import make_scene
from bokehnet.scenes.sensor_depth import depth_along_sensor
from bokehnet.settings.settings import CameraSettings, DepthSettings, FocusSettings, RenderSettings
from bokehnet.tools.demo import demo_scene

__all__ = ["TILTS", "best_focus", "focus_of", "sensor_axes", "tilted_camera", "trace_wall", "zero_line"]

TILTS = ((10.0, 0.0), (-10.0, 0.0), (0.0, 10.0), (0.0, -10.0), (6.0, -8.0), (-12.0, 5.0))

_FOCAL_LENGTH, _SENSOR_WIDTH = 50.0, 36.0
_SENSOR_DISTANCE = 56.0  # mm, along the normal of the sensor
_LEAN = 0.1  # pixels of defocus by which the wall leans per pixel
_OFFSET = 5.0  # pixels of defocus of the wall in the middle


def tilted_camera(tilt: tuple[float, float], width: int, height: int, f_number: float = 1.0) -> Camera:
    """A thin lens in front of the middle of a tilted sensor, as far from it as ``_SENSOR_DISTANCE``."""
    lens = ThinLens(focal_length=_FOCAL_LENGTH, f_number=f_number)
    normal = sensor_axes(TiltShift(lens=lens, tilt=tilt))[2]
    x, y, z = -_SENSOR_DISTANCE * normal
    moved = TiltShift(lens=lens, tilt=tilt, shift=(x, y), offset=-z - lens.sensor_distance)
    return Camera(lens=moved, width=width, height=height, pixel_pitch=_SENSOR_WIDTH / width)


def sensor_axes(lens: TiltShift) -> np.ndarray:
    """Rows: the directions right, down and along its normal of a sensor, in the axes of its lens."""
    place, behind = lens.place(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    corners = np.column_stack([place, -behind])
    right, down = corners[1:] - corners[0]
    return np.stack([right, down, np.cross(right, down)])


def focus_of(camera: Camera) -> float:
    """Depth along the normal of the sensor where the rays of the middle of the picture meet, mm."""
    assert isinstance(camera.lens, TiltShift)
    bundle = camera.lens.sample_rays(np.zeros((2, 2)), np.array([[-0.5, 0.3], [0.5, -0.3]]))
    across = np.diff(bundle.origin, axis=0)[0], np.diff(bundle.slope, axis=0)[0]
    depth = -(across[0] @ across[1]) / (across[1] @ across[1])
    return float(sensor_axes(camera.lens)[2] @ [*(bundle.origin + depth * bundle.slope)[0], depth])


def trace_wall(camera: Camera, samples: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A wall of noise that leans against the plane of focus, traced with the random rays of ``seed``.

    Returns:
        Bokeh and all-in-focus picture, (H, W, 3), and depth along the normal of the sensor, mm, (H, W).
    """
    lens = camera.lens
    assert isinstance(lens, TiltShift)
    assert isinstance(lens.lens, ThinLens)
    axes = sensor_axes(lens)
    per_slope = lens.lens.pupil_radius * _SENSOR_DISTANCE / camera.pixel_pitch  # pixels per 1/mm
    # The lens's axis in the sensor's axes is its third column: the focus gets nearer where it points to.
    towards = axes[:2, 2] / np.linalg.norm(axes[:2, 2])
    middle = 1 / focus_of(camera) + _OFFSET / per_slope
    leaning = -_LEAN * towards * _SENSOR_DISTANCE / camera.pixel_pitch / per_slope  # per unit of x / z
    # The points with (leaning, middle) . X = 1 in the sensor's axes; its middle is on the normal.
    directions = np.array([[1.0, 0.0, -leaning[0] / middle], [0.0, 1.0, -leaning[1] / middle]])
    half = 2.5 * _SENSOR_WIDTH / (middle * _SENSOR_DISTANCE)
    texel = camera.pixel_pitch / (middle * _SENSOR_DISTANCE)
    rng = np.random.default_rng(0)
    count = int(2 * half / texel / 1.5)
    noise = np.stack([fractal_noise(count, count, rng, power=0.8) for _ in range(3)], -1)
    quad = Quad(
        centre=tuple(np.array([0.0, 0.0, 1 / middle]) @ axes),
        u_axis=tuple(half * directions[0] @ axes),
        v_axis=tuple(half * directions[1] @ axes),
    )
    material = Material(emission=(1.0, 1.0, 1.0), texture=plane_texture(noise))
    tracer = Tracer(World(bodies=(Body(shape=quad, material=material),)), camera, seed=seed, bounces=0)
    film = tracer.render(samples)
    depth = depth_along_sensor(camera, tracer.maps().depth)
    assert bool(torch.isfinite(depth).all()), "the wall does not fill the picture"
    return film.bokeh.numpy(), film.all_in_focus.numpy(), depth.numpy()


def best_focus(bokeh: np.ndarray, sharp: np.ndarray, strips: int) -> tuple[np.ndarray, np.ndarray]:
    """Where a picture is sharpest in each of ``strips`` vertical strips: columns, and rows.

    Sharpness is the energy of the differences between neighbours over that of the all-in-focus picture. As it
    falls evenly to both sides, the middle of the upper half of its peak is the best focus.
    """
    energies = []
    for picture in (bokeh, sharp):
        along, across = np.diff(picture, axis=1)[:-1], np.diff(picture, axis=0)[:, :-1]
        energies.append((along**2 + across**2).sum(-1))
    edges = np.linspace(0, energies[0].shape[1], strips + 1).astype(int)
    rows = np.arange(len(energies[0])) + 0.5  # differences lie between two rows
    found = []
    for left, right in pairwise(edges):
        profiles = [np.convolve(energy[:, left:right].sum(1), np.ones(7), "same") for energy in energies]
        sharpness = profiles[0] / profiles[1]
        upper = np.maximum(sharpness / sharpness.max() - 0.5, 0)
        found.append((upper * rows).sum() / upper.sum())
    return (edges[1:] + edges[:-1]) / 2 - 0.5, np.array(found)


def zero_line(defocus: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Rows where a defocus map, that rises or falls down the picture, is 0, between its columns too."""
    rows = []
    for column in columns:
        left = int(column)
        line = defocus[:, left] + (column - left) * (defocus[:, left + 1] - defocus[:, left])
        order = np.argsort(line)
        rows.append(np.interp(0, line[order], np.arange(len(line), dtype=float)[order]))
    return np.array(rows)


def focused_lens(
    camera: Camera, tilt: tuple[float, float], depth: np.ndarray
) -> tuple[FocusedLens, np.ndarray]:
    """What ``bokehnet render`` makes of this camera and a depth map, mm; and the disparity, 1/mm."""
    assert isinstance(camera.lens, TiltShift)
    assert isinstance(camera.lens.lens, ThinLens)
    source = MetricDepth(map=depth.astype(np.float32), unit="mm")
    scene = make_scene(np.zeros((*depth.shape, 3), np.float32), source)
    focus = FocusSettings(distance=focus_of(camera) / 1000, tilt_x=tilt[0], tilt_y=tilt[1])
    numbers = CameraSettings(
        focal_length=_FOCAL_LENGTH, f_number=camera.lens.lens.f_number, sensor_width=_SENSOR_WIDTH
    )
    return focus_lens(scene.depth, scene.window, focus, numbers), scene.depth.values


def _psnr(picture: np.ndarray, truth: np.ndarray, border: int) -> float:
    inside = slice(border, -border)
    return -10 * math.log10(float(((picture - truth)[inside, inside] ** 2).mean()))


def _compare(tilt: tuple[float, float], width: int, height: int, samples: int) -> None:
    camera = tilted_camera(tilt, width, height)
    truth, sharp, depth = trace_wall(camera, samples)
    again, *_ = trace_wall(camera, samples, seed=1)
    lens, disparity = focused_lens(camera, tilt, depth)
    defocus, aberration_map = lens.defocus(disparity), lens.aberration_map()
    assert aberration_map is not None
    turned = abs(tilt[1]) > abs(tilt[0])
    bokeh, image, blur = (np.swapaxes(x, 0, 1) if turned else x for x in (truth, sharp, defocus))
    columns, rows = best_focus(bokeh, image, 6)
    apart = np.abs(rows - zero_line(blur, columns))
    border = math.ceil(1.5 * np.abs(defocus).max())
    pictures = {
        "conic": rays(sharp, defocus, lens_response=LensResponse(aberration_map=aberration_map)),
        "round": rays(sharp, defocus),
        "scatter": scatter(sharp, defocus),
        "slices": _from_slices(sharp, disparity, lens),
        "noise": again,
    }
    figures = "  ".join(f"{_psnr(picture, truth, border):7.2f}" for picture in pictures.values())
    lean = math.hypot(*aberration_map.tilt)
    print(f"{tilt[0]:6g} {tilt[1]:6g}  {apart.mean():6.2f} {apart.max():6.2f}  {lean:5.3f}  {figures}")


def _from_slices(sharp: np.ndarray, disparity: np.ndarray, lens: FocusedLens) -> np.ndarray:
    """The same by slices of the space behind the lens, a pixel of blur apart."""
    assert lens.plane is not None
    plane, blur = lens.plane(lens.near)
    height, width = disparity.shape
    corners = [plane.at(x, y) for x in (0, width - 1) for y in (0, height - 1)]
    count = 2 + math.ceil(blur * (max(corners) - min(corners)))
    return image_space(sharp, disparity, blur, (min(corners), max(corners)), count=count).view(plane)


def draw_sheet(path: Path) -> None:
    """Write the demo's scene with an upright plane of focus, with its table in focus, and as a miniature."""
    scene, blur = demo_scene(), CameraSettings(blur=26)
    ways = (
        FocusSettings(at=(300, 300)),
        FocusSettings(plane=((80, 440), (660, 440), (360, 350))),
        FocusSettings(at=(300, 300), tilt_x=60.0),
    )
    renderer, exact = bokehnet.BokehRenderer(), DepthSettings(repair="off")
    pictures = [
        renderer.render(scene, RenderSettings(camera=blur, focus=way, depth=exact)).bokeh for way in ways
    ]
    sheet = np.concatenate(pictures, axis=1)
    height, width, _ = sheet.shape
    write_image(path, sheet.reshape(height // 2, 2, width // 2, 2, 3).mean((1, 3)))


def main() -> None:
    """Print the table, or draw the sheet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=240)
    parser.add_argument("--height", type=int, default=180)
    parser.add_argument("--samples", type=int, default=128)
    parser.add_argument("--sheet", type=Path, help="draw this picture of the demo's scene instead")
    given = parser.parse_args()
    if given.sheet is not None:
        draw_sheet(given.sheet)
        return
    print("tilt x, y      line of best focus, px   lean   PSNR against the traced picture, dB")
    print(
        "               mean    max             px/px  rays conic, rays round, scatter, slices, traced again"
    )
    for tilt in TILTS:
        _compare(tilt, given.width, given.height, given.samples)


if __name__ == "__main__":
    main()

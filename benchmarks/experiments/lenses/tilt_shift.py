"""Tilted planes of focus compared with the ray tracer's tilted sensor.

``python -m benchmarks.experiments.lenses.tilt_shift`` traces walls of noise with a tilted sensor, locates the
line of best focus by the sharpness of the traced pictures, and prints its distance from the zero line of the
defocus map of ``bokehnet render``, and the PSNR of rendered pictures against the traced ones, away from the
border.
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
_TILT_GRADIENT = 0.1  # of the wall, pixels of defocus per pixel
_OFFSET = 5.0  # defocus of the wall in the picture centre, pixels


def tilted_camera(tilt: tuple[float, float], width: int, height: int, f_number: float = 1.0) -> Camera:
    """Return a camera with a thin lens at ``_SENSOR_DISTANCE`` in front of the centre of a tilted sensor."""
    lens = ThinLens(focal_length=_FOCAL_LENGTH, f_number=f_number)
    normal = sensor_axes(TiltShift(lens=lens, tilt=tilt))[2]
    x, y, z = -_SENSOR_DISTANCE * normal
    tilted_lens = TiltShift(lens=lens, tilt=tilt, shift=(x, y), offset=-z - lens.sensor_distance)
    return Camera(lens=tilted_lens, width=width, height=height, pixel_pitch=_SENSOR_WIDTH / width)


def sensor_axes(lens: TiltShift) -> np.ndarray:
    """Return as rows the directions right, down and normal of a sensor, in the axes of its lens."""
    position, offset = lens.place(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    corners = np.column_stack([position, -offset])
    right, down = corners[1:] - corners[0]
    return np.stack([right, down, np.cross(right, down)])


def focus_of(camera: Camera) -> float:
    """Return the depth along the sensor normal at which the rays of the picture centre meet, mm."""
    assert isinstance(camera.lens, TiltShift)
    bundle = camera.lens.sample_rays(np.zeros((2, 2)), np.array([[-0.5, 0.3], [0.5, -0.3]]))
    across = np.diff(bundle.origin, axis=0)[0], np.diff(bundle.slope, axis=0)[0]
    depth = -(across[0] @ across[1]) / (across[1] @ across[1])
    return float(sensor_axes(camera.lens)[2] @ [*(bundle.origin + depth * bundle.slope)[0], depth])


def trace_wall(camera: Camera, samples: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Trace a wall of noise that is tilted relative to the plane of focus, with the random rays of ``seed``.

    Returns:
        Bokeh and all-in-focus picture, (H, W, 3), and depth along the normal of the sensor, mm, (H, W).
    """
    lens = camera.lens
    assert isinstance(lens, TiltShift)
    assert isinstance(lens.lens, ThinLens)
    axes = sensor_axes(lens)
    per_slope = lens.lens.pupil_radius * _SENSOR_DISTANCE / camera.pixel_pitch  # pixels per 1/mm
    # The third column is the lens axis in sensor axes: the focus is nearer in its direction.
    azimuth = axes[:2, 2] / np.linalg.norm(axes[:2, 2])
    middle = 1 / focus_of(camera) + _OFFSET / per_slope
    gradient = (
        -_TILT_GRADIENT * azimuth * _SENSOR_DISTANCE / camera.pixel_pitch / per_slope
    )  # per unit of x / z
    # The points with (gradient, middle) . X = 1 in sensor axes; the centre is on the normal.
    directions = np.array([[1.0, 0.0, -gradient[0] / middle], [0.0, 1.0, -gradient[1] / middle]])
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
    """Return columns and rows of the sharpest points in each of ``strips`` vertical strips.

    Sharpness is the energy of neighbour differences relative to the all-in-focus picture. It decreases
    symmetrically, so the best focus is the centroid of the upper half of its peak.
    """
    energies = []
    for picture in (bokeh, sharp):
        along, across = np.diff(picture, axis=1)[:-1], np.diff(picture, axis=0)[:, :-1]
        energies.append((along**2 + across**2).sum(-1))
    edges = np.linspace(0, energies[0].shape[1], strips + 1).astype(int)
    rows = np.arange(len(energies[0])) + 0.5  # differences lie between two rows
    focus_rows = []
    for left, right in pairwise(edges):
        profiles = [np.convolve(energy[:, left:right].sum(1), np.ones(7), "same") for energy in energies]
        sharpness = profiles[0] / profiles[1]
        upper = np.maximum(sharpness / sharpness.max() - 0.5, 0)
        focus_rows.append((upper * rows).sum() / upper.sum())
    return (edges[1:] + edges[:-1]) / 2 - 0.5, np.array(focus_rows)


def zero_line(defocus: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return the rows of zero defocus, for a map monotonic along columns, also at fractional columns."""
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
    """Return the focused lens of ``bokehnet render`` for this camera, mm, and the disparity, 1/mm."""
    assert isinstance(camera.lens, TiltShift)
    assert isinstance(camera.lens.lens, ThinLens)
    source = MetricDepth(map=depth.astype(np.float32), unit="mm")
    scene = make_scene(np.zeros((*depth.shape, 3), np.float32), source)
    focus = FocusSettings(distance=focus_of(camera) / 1000, tilt_x=tilt[0], tilt_y=tilt[1])
    camera_settings = CameraSettings(
        focal_length=_FOCAL_LENGTH, f_number=camera.lens.lens.f_number, sensor_width=_SENSOR_WIDTH
    )
    return focus_lens(scene.depth, scene.window, focus, camera_settings), scene.depth.values


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
    transposed = abs(tilt[1]) > abs(tilt[0])
    bokeh, image, blur = (np.swapaxes(x, 0, 1) if transposed else x for x in (truth, sharp, defocus))
    columns, rows = best_focus(bokeh, image, 6)
    distance = np.abs(rows - zero_line(blur, columns))
    border = math.ceil(1.5 * np.abs(defocus).max())
    pictures = {
        "conic": rays(sharp, defocus, lens_response=LensResponse(aberration_map=aberration_map)),
        "round": rays(sharp, defocus),
        "scatter": scatter(sharp, defocus),
        "slices": _from_slices(sharp, disparity, lens),
        "noise": again,
    }
    figures = "  ".join(f"{_psnr(picture, truth, border):7.2f}" for picture in pictures.values())
    gradient = math.hypot(*aberration_map.tilt)
    print(
        f"{tilt[0]:6g} {tilt[1]:6g}  {distance.mean():6.2f} {distance.max():6.2f}  {gradient:5.3f}  {figures}"
    )


def _from_slices(sharp: np.ndarray, disparity: np.ndarray, lens: FocusedLens) -> np.ndarray:
    """Return the picture by slices of the image space, one pixel of blur apart."""
    assert lens.plane is not None
    plane, blur = lens.plane(lens.near)
    height, width = disparity.shape
    corners = [plane.at(x, y) for x in (0, width - 1) for y in (0, height - 1)]
    count = 2 + math.ceil(blur * (max(corners) - min(corners)))
    return image_space(sharp, disparity, blur, (min(corners), max(corners)), count=count).view(plane)


def draw_sheet(path: Path) -> None:
    """Write the demo scene with an untilted plane of focus, with its table in focus, and as a miniature."""
    scene, blur = demo_scene(), CameraSettings(blur=26)
    focus_settings = (
        FocusSettings(at=(300, 300)),
        FocusSettings(plane=((80, 440), (660, 440), (360, 350))),
        FocusSettings(at=(300, 300), tilt_x=60.0),
    )
    renderer, exact = bokehnet.BokehRenderer(), DepthSettings(repair="off")
    pictures = [
        renderer.render(scene, RenderSettings(camera=blur, focus=focus, depth=exact)).bokeh
        for focus in focus_settings
    ]
    sheet = np.concatenate(pictures, axis=1)
    height, width, _ = sheet.shape
    write_image(path, sheet.reshape(height // 2, 2, width // 2, 2, 3).mean((1, 3)))


def main() -> None:
    """Print the table, or write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=240)
    parser.add_argument("--height", type=int, default=180)
    parser.add_argument("--samples", type=int, default=128)
    parser.add_argument("--sheet", type=Path, help="write a picture of the demo scene to this file instead")
    arguments = parser.parse_args()
    if arguments.sheet is not None:
        draw_sheet(arguments.sheet)
        return
    print("tilt x, y      line of best focus, px   tilt   PSNR against the traced picture, dB")
    print(
        "               mean    max             px/px  rays conic, rays round, scatter, slices, traced again"
    )
    for tilt in TILTS:
        _compare(tilt, arguments.width, arguments.height, arguments.samples)


if __name__ == "__main__":
    main()

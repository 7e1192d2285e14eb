"""Convergence and speed of the ray tracer: ``python -m benchmarks.speed.raytrace``.

Prints the error by number of samples for random, stratified and Halton points (``--plot`` draws it), the
camera rays per second compared with Mitsuba 3 on the same cores, and the training pairs per minute
(:mod:`benchmarks.speed.training_pairs`). ``--device cuda`` measures rays and pairs on a GPU. Run it on an
idle machine.
"""

import argparse
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks.measurement import median_seconds
from benchmarks.speed.training_pairs import print_pairs
from bokehnet.lenses import ThinLens
from bokehnet.optics.sampling import disc_from_square, halton, rotate_points
from bokehnet.raytrace import (
    Background,
    Camera,
    Plane,
    Scene,
    background_from,
    plane_texture,
    render_bokeh,
)
from bokehnet.raytrace.paths import trace_paths
from bokehnet.raytrace.tracer import Tracer, lens_rays
from bokehnet.raytrace.world import World, world_from_scene

__all__ = ["convergence", "main"]


def plane_scene(device: torch.device) -> Scene:
    """Return textured cards in front of, in and behind focus, with a picture at infinity."""
    rng = np.random.default_rng(0)

    def blocks() -> np.ndarray:
        return np.kron(rng.random((8, 12, 3), np.float32), np.ones((16, 16, 1), np.float32))

    planes = [
        Plane(texture=plane_texture(blocks()).to(device), centre=centre, u_axis=u, v_axis=v)
        for centre, u, v in (
            ((-110.0, 40.0, 700.0), (100.0, 10.0, 20.0), (-10.0, 70.0, 30.0)),
            ((60.0, -30.0, 1200.0), (180.0, 0.0, -60.0), (0.0, 120.0, 0.0)),
            ((300.0, 100.0, 2500.0), (400.0, 50.0, 0.0), (-50.0, 300.0, 0.0)),
        )
    ]
    sky = background_from(blocks(), (0.45, 0.45))  # larger than the view, outside of which it is clamped
    background = Background(texture=sky.texture.to(device), half_extent=sky.half_extent)
    return Scene(background=background, planes=tuple(planes))


def camera(width: int, height: int) -> Camera:
    """Return a camera with an 80 mm pupil that blurs all cards except the middle one."""
    lens = ThinLens(focal_length=50.0, f_number=0.625, focus_distance=1200.0)
    return Camera(lens=lens, width=width, height=height, pixel_pitch=36 / width)


def random_points(count: int, pixels: int, rng: np.random.Generator) -> np.ndarray:
    """Return independent points (count, pixels, 4) for pupil and pixel."""
    return rng.random((count, pixels, 4))


def stratified_points(count: int, pixels: int, rng: np.random.Generator) -> np.ndarray:
    """Return one random point per cell of a square grid; cells of pupil and pixel are paired at random."""
    side = math.isqrt(count)
    cells = np.stack(np.divmod(np.arange(side * side), side), -1)
    halves = []
    for _ in range(2):
        order = rng.permuted(np.tile(np.arange(side * side), (pixels, 1)), axis=1).T
        halves.append((cells[order] + rng.random((side * side, pixels, 2))) / side)
    return np.concatenate(halves, -1)


def halton_points(count: int, pixels: int, rng: np.random.Generator) -> np.ndarray:
    """Return one Halton sequence with a shift per pixel."""
    points = np.stack([halton(count, base) for base in (2, 3, 5, 7)], -1)
    return rotate_points(points[:, None], rng.random((pixels, 4)))


_PATTERNS: dict[str, Callable[[int, int, np.random.Generator], np.ndarray]] = {
    "random": random_points,
    "stratified": stratified_points,
    "Halton": halton_points,
}


def _picture(world: World, view: Camera, points: np.ndarray) -> Tensor:
    """Return the mean colour (P, 3) over points (N, P, 4)."""
    sensor = view.sensor_xy(torch.device("cpu"), torch.float32).reshape(-1, 2)
    total = torch.zeros(len(sensor), 3)
    for point in torch.from_numpy(points.astype(np.float32)):
        position = sensor + view.pixel_pitch * (point[:, 2:] - 0.5)
        rays, _ = lens_rays(view, position, disc_from_square(point[:, :2]), torch.zeros(len(sensor)))
        total += trace_paths(world, rays, lambda dimension, row: torch.zeros(len(row)), 0).color
    return total / len(points)


def convergence(counts: tuple[int, ...], repeats: int = 4) -> dict[str, list[float]]:
    """Return the root mean square error of each pattern for each number of samples on a small plane scene."""
    world, view = world_from_scene(plane_scene(torch.device("cpu"))), camera(48, 32)
    pixels = view.width * view.height
    truth = _picture(world, view, halton_points(16 * max(counts), pixels, np.random.default_rng(99)))
    errors: dict[str, list[float]] = {name: [] for name in _PATTERNS}
    for count in counts:
        for name, pattern in _PATTERNS.items():
            squares = [
                (_picture(world, view, pattern(count, pixels, np.random.default_rng(seed))) - truth)
                .square()
                .mean()
                for seed in range(repeats)
            ]
            errors[name].append(math.sqrt(float(torch.stack(squares).mean())))
    return errors


def _print_convergence(plot: Path | None) -> None:
    counts = (4, 16, 64, 256)
    errors = convergence(counts)
    print("error (RMS) over samples   " + "".join(f"{count:>10d}" for count in counts) + "     falls as")
    for name, values in errors.items():
        slope = np.polyfit(np.log(counts), np.log(values), 1)[0]
        print(f"  {name:24s} " + "".join(f"{value:10.5f}" for value in values) + f"   N^{slope:.2f}")
    if plot is not None:
        import matplotlib.pyplot as plt

        for name, values in errors.items():
            plt.loglog(counts, values, "o-", label=name)
        plt.xlabel("samples per pixel")
        plt.ylabel("root-mean-square error")
        plt.legend()
        plt.savefig(plot, dpi=120)
        print(f"wrote {plot}")


def _mitsuba_scene(scene: Scene, view: Camera, samples: int) -> Any:
    import mitsuba as mi

    lens = view.lens
    assert isinstance(lens, ThinLens)

    def bitmap(texture: Tensor) -> dict[str, Any]:
        values = np.ascontiguousarray(texture[:3].permute(1, 2, 0).cpu().numpy())
        return {"type": "bitmap", "bitmap": mi.Bitmap(values), "raw": True, "wrap_mode": "clamp"}

    def card(centre: Any, u: Any, v: Any, texture: Tensor) -> dict[str, Any]:
        matrix = np.eye(4)
        normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
        matrix[:3] = np.stack([u, v, normal, centre], 1)
        return {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(matrix),
            "flip_normals": True,
            "emitter": {"type": "area", "radiance": bitmap(texture)},
        }

    far, half = 1e6, scene.background.half_extent
    entries: dict[str, Any] = {
        f"card{index}": card(plane.centre, plane.u_axis, plane.v_axis, plane.texture)
        for index, plane in enumerate(scene.planes)
    }
    entries["sky"] = card((0, 0, far), (half[0] * far, 0, 0), (0, half[1] * far, 0), scene.background.texture)
    film = {
        "type": "hdrfilm",
        "width": view.width,
        "height": view.height,
        "pixel_format": "rgb",
        "rfilter": {"type": "box"},
    }
    sensor = {
        "type": "thinlens",
        "aperture_radius": lens.pupil_radius,
        "focus_distance": lens.focus_distance,
        "fov": math.degrees(2 * math.atan(18 / lens.sensor_distance)),
        "fov_axis": "x",
        "near_clip": 1.0,
        "far_clip": 2 * far,
        "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 0], target=[0, 0, 1], up=[0, -1, 0]),
        "film": film,
        "sampler": {"type": "independent", "sample_count": samples},
    }
    integrator = {"type": "path", "max_depth": 1}
    return mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor, **entries})


def _print_rates(device: torch.device, width: int, height: int, samples: int) -> None:
    """Print camera rays per second on the plane scene, and the PSNR between the pictures."""
    scene, view = plane_scene(device), camera(width, height)
    tracer = Tracer(world_from_scene(scene), view, bounces=0, device=device)
    rays = width * height * samples
    pictures: dict[str, np.ndarray] = {}

    def rate(name: str, run: Callable[[], Any], count: int = rays) -> None:
        pictures[name] = np.asarray(run())  # the first run warms up
        seconds = median_seconds(run, 3)
        print(f"  {name:40s} {count / seconds / 1e6:8.2f} million rays/s")

    print(f"plane scene, {width}x{height}, {samples} samples, {device}, {torch.get_num_threads()} threads")
    rate("ours, planes (synth)", lambda: render_bokeh(scene, view, samples, 0).cpu())
    # For each ray through the pupil, the general tracer also traces one through the pupil centre.
    rate("ours, general", lambda: tracer.render(samples).bokeh.cpu(), 2 * rays)
    try:
        import mitsuba as mi
    except ImportError:
        print("  Mitsuba is not installed: pip install 'bokehnet[dev]'")
        return
    mi.set_variant("scalar_rgb")
    external = _mitsuba_scene(scene, view, samples)
    rate(f"Mitsuba {mi.__version__} scalar_rgb", lambda: np.array(mi.render(external)))
    reference = pictures["ours, planes (synth)"]
    for name, picture in pictures.items():
        error = float(np.sqrt(np.mean((picture - reference) ** 2)))
        if error:
            print(f"  {name} against the first: {-20 * math.log10(error):.1f} dB")


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--size", type=int, nargs=2, default=(256, 256), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--scenes", type=int, default=6, help="scenes for the training pairs")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument(
        "--plot", type=Path, help="write a plot of the convergence to this file (needs matplotlib)"
    )
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    device = torch.device(arguments.device)
    _print_convergence(arguments.plot)
    _print_rates(device, *arguments.size, arguments.samples)
    print_pairs(device, arguments.scenes)


if __name__ == "__main__":
    main()

"""Optimizations of mesh views after thesis 002: ``python -m benchmarks.experiments.edges.level_of_detail``.

Draws nine bumpy balls of 131 072 triangles each, from near to far behind focus, with
:mod:`bokehnet.baselines.rays.mesh_views` in N views with S subsamples around each. Prints processor seconds,
triangles, PSNR and SSIM against 256 views of all triangles; finally the time of Embree for the same number of
rays on the finest and the coarsest level.
"""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from time import process_time

import numpy as np

from bokehnet.baselines.rays.mesh_views import MeshObject, Picture, render_views, subsample_blur
from bokehnet.baselines.rays.n_buffers import n_buffers
from bokehnet.io.image import write_image
from bokehnet.lenses import ThinLens
from train.scores.metrics import encode, psnr, similarity

_PICTURE = Picture(width=320, height=240, pixel_pitch=36 / 320)
_LENS = ThinLens(focal_length=85.0, f_number=1.2, focus_distance=1500.0)
_ROWS, _LEVELS, _TRUTH = 256, 11, 256


def ball(centre: tuple[float, float, float], radius: float, seed: int) -> MeshObject:
    """Return a bumpy ball lit from above; each level has every other line of the previous grid, smoothed."""
    rng = np.random.default_rng(seed)
    down, around = np.linspace(0, math.pi, _ROWS + 1), np.linspace(0, 2 * math.pi, _ROWS + 1)
    theta, phi = np.meshgrid(down, around, indexing="ij")
    bumps, stripes = np.zeros_like(theta), np.zeros_like(theta)
    for _ in range(12):
        a, b = rng.integers(1, 30, 2)
        wave = np.sin(a * theta + rng.uniform(0, 7)) * np.sin(b * phi) * np.sin(theta)
        bumps += 0.15 * wave / max(a, b)
        stripes += wave
    r = radius * (1 + bumps)
    points = np.stack(
        [r * np.sin(theta) * np.cos(phi), r * np.cos(theta), r * np.sin(theta) * np.sin(phi)], -1
    )
    normal = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
    normal *= np.sign((normal * points).sum(-1, keepdims=True))
    lit = 0.15 + 0.85 * np.clip(-normal @ np.array([0.3, 0.8, 0.5]), 0, 1)
    paint = rng.uniform(0.2, 0.9, (2, 3))
    colors = np.where((stripes > 0)[..., None], paint[0], paint[1]) * lit[..., None]
    levels, values = [], np.concatenate([points + np.array(centre), colors], -1)
    for level in range(_LEVELS):
        if level:
            values = halved(values, (level - 1) % 2)
        grid = values[..., :3]
        rows, columns = grid.shape[:2]
        index = np.arange(rows * columns).reshape(rows, columns)
        a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
        faces = np.concatenate(
            [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([d, c, b], -1).reshape(-1, 3)]
        )
        levels.append((grid.reshape(-1, 3).copy(), values[..., 3:].reshape(-1, 3).copy(), faces))
    return MeshObject(levels=tuple(levels))


def halved(values: np.ndarray, axis: int) -> np.ndarray:
    """Return every other line of a grid along an axis, smoothed with its neighbours except at the ends."""
    lines = np.moveaxis(values, axis, 0)
    reduced = lines[::2].copy()
    reduced[1:-1] = 0.5 * lines[2:-1:2] + 0.25 * (lines[1:-2:2] + lines[3::2])
    return np.moveaxis(reduced, 0, axis)


def scene() -> list[MeshObject]:
    """Return balls on a diagonal from the near left to the far right."""
    depths = (500, 700, 900, 1200, 1500, 1900, 2500, 3500, 5000)
    return [
        ball((z * (-0.16 + 0.04 * k), z * 0.05 * (-1) ** k, float(z)), 0.055 * z, k)
        for k, z in enumerate(depths)
    ]


def around(views: int, count: int) -> np.ndarray:
    """Return points (count, 2) in a disc of the pupil area per view, in pupil radii."""
    k = np.arange(count) + 0.5
    radius, angle = np.sqrt(k / count / views), k * math.pi * (3 - math.sqrt(5))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)


def blurred(views: int, count: int) -> Callable[[np.ndarray, np.ndarray], np.ndarray] | None:
    """Return the blur between views, or None without subsamples."""
    if not count:
        return None
    points = around(views, count)

    def blur(light: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        radius = np.asarray(_LENS.coc_radius(inverse.astype(np.float64))) / _PICTURE.pixel_pitch
        return np.asarray(subsample_blur(light, radius, points, *n_buffers(radius)))

    return blur


def embree(objects: list[MeshObject], level: int, rays: int) -> float:
    """Return the processor seconds of rays on objects of one level, without building the tree."""
    import torch

    from bokehnet.raytrace.geometry.meshes import Mesh
    from bokehnet.raytrace.geometry.space import SpaceRays

    parts, count = [], 0
    corners = np.concatenate([mesh_object.levels[level][0] for mesh_object in objects])
    for mesh_object in objects:
        parts.append(mesh_object.levels[level][2] + count)
        count += len(mesh_object.levels[level][0])
    mesh = Mesh(corners, np.concatenate(parts))
    rng = np.random.default_rng(0)
    origin = np.zeros((rays, 3), np.float32)
    origin[:, :2] = rng.normal(0, 15, (rays, 2))
    target = rng.uniform(-0.2, 0.2, (rays, 3)) * 1500
    target[:, 2] = 1500
    direction = ((target - origin) / 1500).astype(np.float32)
    shot = SpaceRays(
        origin=torch.from_numpy(origin), direction=torch.from_numpy(direction), time=torch.zeros(rays)
    )
    start = process_time()
    mesh.intersect(shot, torch.zeros(rays))
    return process_time() - start


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--truth", type=int, default=_TRUTH)
    parser.add_argument("--sheet", type=Path, help="write the pictures side by side to this file")
    arguments = parser.parse_args()
    objects = scene()
    whole = sum(len(mesh_object.levels[0][2]) for mesh_object in objects)
    render_views(objects, _LENS, _PICTURE, 1, blur=blurred(1, 1))  # compiles
    truth = render_views(objects, _LENS, _PICTURE, arguments.truth).bokeh
    shown, pictures = encode(truth), [truth]
    print(f"{whole} triangles, {_PICTURE.width}x{_PICTURE.height} pixels")
    print(f"{'N':>4s}{'S':>3s}  {'saves by':22s}{'seconds':>9s}{'triangles':>11s}{'PSNR':>8s}{'SSIM':>8s}")
    variants = [(count, 0, None, False) for count in (16, 32, 64, 128)]
    variants += [(32, 0, 0, False), (32, 0, 2, False), (32, 0, 4, False), (32, 0, None, True)]
    variants += [(32, 0, 2, True), (16, 8, 2, True), (32, 4, 2, True), (64, 0, 2, True), (32, 4, None, False)]
    for views, subsamples, finer, reuse in variants:
        start = process_time()
        result = render_views(
            objects,
            _LENS,
            _PICTURE,
            views,
            finer=finer,
            reuse=reuse,
            blur=blurred(views, subsamples),
        )
        seconds, encoded = process_time() - start, encode(result.bokeh)
        words = [] if finer is None else [f"levels, {finer} finer" if finer else "levels"]
        label = ", ".join(words + ["reuse"] * reuse) or "nothing"
        fraction = result.triangles / (views * whole)
        quality = f"{psnr((encoded - shown) ** 2):8.2f}{similarity(shown, encoded)[0]:8.4f}"
        print(f"{views:4d}{subsamples:3d}  {label:22s}{seconds:9.2f}{fraction:11.1%}{quality}", flush=True)
        if (views, subsamples) == (32, 4) and reuse:
            pictures.append(result.bokeh)
    for level in (0, _LEVELS - 1):
        count = sum(len(mesh_object.levels[level][2]) for mesh_object in objects)
        print(f"Embree, {count} triangles: {embree(objects, level, 1_000_000):.2f} s per million rays")
    if arguments.sheet:
        write_image(arguments.sheet, np.concatenate(pictures, 1))


if __name__ == "__main__":
    main()

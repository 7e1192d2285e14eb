"""Blur a scene by a post-process, with rays where the post-process can be wrong.

``python examples/selective_rays.py`` reads a scene file and renders the buffers of a game renderer (a sharp
picture, depth and normals). The package's tracer traces the rays; any renderer with ray queries could replace
it. Prints PSNR over all pixels and at depth edges, and rays per pixel; ``--sheet FILE`` saves the pictures.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import torch

import bokehnet
from bokehnet.baselines.rays.selective_rays import RaySelection, TraceRays, selective_rays
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.optics.pixels.sample_allocation import neyman
from bokehnet.raytrace.geometry.space import SpaceRays
from bokehnet.raytrace.paths import trace_paths
from bokehnet.scenes import SceneJob, read_scene
from bokehnet.tools.contact_sheet import contact_sheet
from train.scores.metrics import compare

_SCENE = Path(__file__).parents[1] / "configs" / "scene_balls.toml"

# Assumed depth of the sky, mm.
_SKY_DEPTH_MM = 1e6


def make_ray_tracer(job: SceneJob, seed: int = 0) -> TraceRays:
    """Return a function that traces rays (N, 3), mm: colour, depth and mask of hits."""
    generator = torch.Generator().manual_seed(seed)

    def number(dimension: torch.Tensor, row: torch.Tensor) -> torch.Tensor:
        return torch.rand(len(row), generator=generator)

    def trace_rays(origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        start, direction = (torch.from_numpy(part.astype(np.float32)) for part in (origins, directions))
        mid_exposure = torch.zeros(len(start))
        rays = SpaceRays(origin=start, direction=direction, time=mid_exposure)
        first = job.world.intersect(rays, mid_exposure, torch.full((len(start),), -1))
        light = trace_paths(job.world, rays, number, job.render.bounces)
        return light.color.numpy(), first.hits.distance.numpy(), (first.body >= 0).numpy()

    return trace_rays


def pictures(job: SceneJob, samples: int, truth: int) -> dict[str, tuple[np.ndarray, float]]:
    """Return post-processes, hybrids, full rays and the truth, each with its rays per pixel.

    Args:
        job: Static scene.
        samples: Rays per pixel of full rays; the hybrids use at most 35 % of them.
        truth: Rays per pixel of the truth.
    """
    tracer = job.tracer()
    maps, image = tracer.maps(), tracer.render(max(16, samples)).all_in_focus.numpy()
    depth = np.minimum(maps.depth.numpy().astype(np.float64), _SKY_DEPTH_MM)
    lens, pitch = job.camera.lens, job.camera.pixel_pitch
    renders: dict[str, tuple[np.ndarray, float]] = {}
    variants = {
        "tan": {},
        "ours": {"mask": "reach", "rule": "ours", "post_process": scatter, "allocation": neyman},
    }
    for name, options in variants.items():
        result = selective_rays(
            image,
            depth,
            maps.normal.numpy(),
            make_ray_tracer(job),
            lens,
            pitch,
            RaySelection(budget=0.35 * samples, max_rays=8, **options),
        )
        renders["tan" if name == "tan" else "scatter"] = result.post_process, 0
        renders[f"hybrid, {name}"] = result.bokeh, float(result.rays.mean())
    sent = max(1, round(result.rays.mean()))
    for name, rays in (("rays, as many", sent), ("rays, all", samples)):
        renders[name] = tracer.render(rays).bokeh.numpy(), rays
    renders["truth"] = job.tracer().render(truth).bokeh.numpy(), truth
    return renders


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scene", type=Path, default=_SCENE)
    parser.add_argument("--width", type=int, default=120)
    parser.add_argument("--height", type=int, default=80)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--truth", type=int, default=256)
    parser.add_argument("--sheet", type=Path)
    arguments = parser.parse_args()
    size = {"camera.width": arguments.width, "camera.height": arguments.height, "camera.shutter": 0.0}
    job = read_scene(arguments.scene, size)
    renders = pictures(job, arguments.samples, arguments.truth)
    disparity = job.tracer().maps().disparity.numpy().astype(np.float64)
    defocus = (np.asarray(job.camera.lens.coc_radius(disparity)) / job.camera.pixel_pitch).astype(np.float32)
    truth = renders["truth"][0]
    for name, (picture, rays) in renders.items():
        if name != "truth":
            scores = compare(picture, truth, defocus)
            values = f"{scores['psnr']:6.2f} dB, at edges {scores['edge_psnr']:6.2f} dB"
            sys.stdout.write(f"{name:16s}{values}, {rays:5.1f} rays per pixel\n")
    if arguments.sheet is not None:
        shown = [(name, picture.repeat(2, 0).repeat(2, 1)) for name, (picture, _) in renders.items()]
        bokehnet.write_image(arguments.sheet, contact_sheet([shown[:4], shown[4:]]))


if __name__ == "__main__":
    torch.set_num_threads(1)  # more threads do not help for small pictures
    main()

"""Blur a scene by a post-process, and send rays into it where that goes wrong.

``python examples/selective_rays.py`` reads a scene file, draws what a renderer of games would have (a sharp
picture, depth and normals) and lets the package's own tracer answer for the rays: any renderer that can say
what a ray meets could stand in its place. Printed are PSNR, over all and at edges of depth, and rays a pixel;
``--sheet FILE`` keeps the pictures.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import torch

import bokehnet
from bokehnet.baselines.rays.selective_rays import TraceRays, selective_rays
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.optics.pixels.sample_allocation import neyman
from bokehnet.raytrace.geometry.space import SpaceRays
from bokehnet.raytrace.paths import trace_paths
from bokehnet.scenes import SceneJob, read_scene
from bokehnet.tools.contact_sheet import contact_sheet
from train.metrics import compare

_SCENE = Path(__file__).parents[1] / "configs" / "scene_balls.toml"

# What the sky's depth is taken to be, mm.
_FAR = 1e6


def answers(job: SceneJob, seed: int = 0) -> TraceRays:
    """What our tracer says of rays (N, 3), mm: colour, depth and whether they hit."""
    generator = torch.Generator().manual_seed(seed)

    def number(dimension: torch.Tensor, row: torch.Tensor) -> torch.Tensor:
        return torch.rand(len(row), generator=generator)

    def trace_rays(origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        start, way = (torch.from_numpy(part.astype(np.float32)) for part in (origins, directions))
        still = torch.zeros(len(start))
        rays = SpaceRays(origin=start, direction=way, time=still)
        first = job.world.intersect(rays, still, torch.full((len(start),), -1))
        light = trace_paths(job.world, rays, number, job.render.bounces)
        return light.color.numpy(), first.hits.distance.numpy(), (first.body >= 0).numpy()

    return trace_rays


def pictures(job: SceneJob, samples: int, truth: int) -> dict[str, tuple[np.ndarray, float]]:
    """Post-processes alone, hybrids, full rays and the truth, each with its rays a pixel.

    Args:
        job: A scene that stands still.
        samples: Rays a pixel that full rays send; the hybrids send at most 35 % of them.
        truth: Rays a pixel of the truth.
    """
    tracer = job.tracer()
    maps, image = tracer.maps(), tracer.render(max(16, samples)).all_in_focus.numpy()
    depth = np.minimum(maps.depth.numpy().astype(np.float64), _FAR)
    lens, pitch = job.camera.lens, job.camera.pixel_pitch
    found: dict[str, tuple[np.ndarray, float]] = {}
    ways = {
        "tan": {},
        "ours": {"mask": "reach", "rule": "ours", "post_process": scatter, "allocation": neyman},
    }
    for name, options in ways.items():
        made = selective_rays(
            image,
            depth,
            maps.normal.numpy(),
            answers(job),
            lens,
            pitch,
            budget=0.35 * samples,
            most=8,
            **options,
        )
        found["tan" if name == "tan" else "scatter"] = made.post_process, 0
        found[f"hybrid, {name}"] = made.bokeh, float(made.rays.mean())
    sent = max(1, round(made.rays.mean()))
    for name, rays in (("rays, as many", sent), ("rays, all", samples)):
        found[name] = tracer.render(rays).bokeh.numpy(), rays
    found["truth"] = job.tracer().render(truth).bokeh.numpy(), truth
    return found


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
    found = pictures(job, arguments.samples, arguments.truth)
    disparity = job.tracer().maps().disparity.numpy().astype(np.float64)
    defocus = (np.asarray(job.camera.lens.coc_radius(disparity)) / job.camera.pixel_pitch).astype(np.float32)
    truth = found["truth"][0]
    for name, (picture, rays) in found.items():
        if name != "truth":
            scores = compare(picture, truth, defocus)
            told = f"{scores['psnr']:6.2f} dB, at edges {scores['edge_psnr']:6.2f} dB"
            sys.stdout.write(f"{name:16s}{told}, {rays:5.1f} rays a pixel\n")
    if arguments.sheet is not None:
        shown = [(name, picture.repeat(2, 0).repeat(2, 1)) for name, (picture, _) in found.items()]
        bokehnet.write_image(arguments.sheet, contact_sheet([shown[:4], shown[4:]]))


if __name__ == "__main__":
    torch.set_num_threads(1)  # small pictures: more wait for each other
    main()

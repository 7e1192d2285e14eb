"""Gain from known edges: ``python -m benchmarks.experiments.edges.edge_knowledge FOLDER``.

FOLDER holds path-traced scenes in the layout of :func:`train.scores.evaluation_sets.path_traced_pictures`;
those with ``image_4x.exr`` and ``depth_4x.exr``, at four times the resolution, are rendered from one sample
per pixel, with ``input.supersampled``, and entirely at four times the resolution with the pixel filter of the
truth, which gives the gain from exact edges. The last lines of a scene are the fractions of that gain. Edge
PSNR is that of :mod:`train.scores.metrics`; seconds are processor time from the read scene to the picture.
"""

import argparse
from itertools import islice
from json import loads
from pathlib import Path
from time import process_time

import numpy as np

from bokehnet import (
    BokehRenderer,
    CameraSettings,
    FocusSettings,
    InputSettings,
    RenderSettings,
    make_scene,
    read_image,
    read_scene,
)
from bokehnet.classical.layered.boundaries.supersampled import reduce_supersampled
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.pixels.pixel_filter import PixelFilter
from bokehnet.optics.pixels.supersampling import downsample
from bokehnet.scene.depth.depth_source import DefocusMap
from train.scores.evaluation_sets import path_traced_shots, scene_folders
from train.scores.metrics import compare

# Label -> picture, map and supersampling factor.
_INPUTS = {
    "one sample": ("image.exr", "depth.exr", 1),
    "coverage": ("image_4x.exr", "depth_4x.exr", 1),
    "two surfaces": ("image_4x.exr", "depth_4x.exr", 1),
    "supersampled 4": ("image_4x.exr", "depth_4x.exr", 4),
    "whole": ("image_4x.exr", "depth_4x.exr", 1),
}

# Pixel filter of the renderer of the scenes.
_FILTER = PixelFilter("blackman-harris", 1.5)


def render(folder: Path, number: int, label: str, aperture: Aperture) -> tuple[np.ndarray, float]:
    """Return the scene-linear picture of a shot and its processor seconds."""
    image, depth, factor = _INPUTS[label]
    scene = loads((folder / "scene.json").read_text(encoding="utf-8"))
    shot = scene["shots"][number]
    settings = RenderSettings(
        input=InputSettings(depth=folder / depth, supersampled=factor),
        camera=CameraSettings(
            focal_length=scene["focal_length_mm"],
            sensor_width=scene["sensor_width_mm"],
            f_number=shot["f_number"],
        ),
        focus=FocusSettings(distance=shot["focus_distance_m"]),
    ).updated({"depth": {"repair": "off"}})
    scene_to_render = read_scene(folder / image, settings)
    renderer = BokehRenderer("rays", aperture=aperture)
    if label in ("coverage", "two surfaces"):
        defocus = renderer.prepare(scene_to_render, settings).defocus
        small, radii, known_edges = reduce_supersampled(scene_to_render.image, defocus, 4, _FILTER)
        if label == "coverage":
            small, known_edges = read_image(folder / "image.exr"), known_edges.without_colors()
        scene_to_render = make_scene(small, DefocusMap(map=radii), known_edges=known_edges)
        settings = RenderSettings()
    start = process_time()
    picture = renderer.render(scene_to_render, settings).bokeh
    if label == "whole":
        picture = downsample(picture, 4, _FILTER)
    return picture, process_time() - start


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shots", type=int, default=5, help="maximum number of shots per scene")
    arguments = parser.parse_args()
    folders = [path for path in scene_folders(arguments.folder) if (path / "image_4x.exr").exists()]
    print(f"{'scene':20s}{'input':18s}{'edge PSNR':>10s}{'seconds':>9s}")
    for folder in folders:
        edge_psnr = {}
        for label in _INPUTS:
            scores, seconds = [], []
            for number, shot in enumerate(islice(path_traced_shots(folder), arguments.shots)):
                picture, elapsed = render(folder, number, label, shot.aperture)
                scores.append(compare(picture, shot.truth, shot.defocus)["edge_psnr"])
                seconds.append(elapsed)
            edge_psnr[label] = float(np.mean(scores))
            print(
                f"{folder.name:20s}{label:18s}{edge_psnr[label]:10.2f}{np.median(seconds):9.2f}", flush=True
            )
        baseline, *partial, upper = edge_psnr.values()
        for label, value in zip(list(edge_psnr)[1:-1], partial, strict=True):
            gain = f"{(value - baseline) / (upper - baseline):.0%} of the gain of {upper - baseline:.2f} dB"
            print(f"{folder.name:20s}{label:18s}{gain}", flush=True)


if __name__ == "__main__":
    main()

"""Rays through layers: time of both walks, and effect of umbra culling.

Run ``python -m benchmarks.experiments.edges.image_rays``.

The scenes are those of :mod:`benchmarks.experiments.edges.true_layers`. Times are processor seconds at 64
rays per pixel; ``lost`` is the fraction of rays without a hit; edge PSNR is that of
:mod:`train.scores.metrics`. For umbra culling, prints the fraction of removed surfaces behind the first, and
the remaining number of layers.
"""

import argparse
from time import process_time

import numpy as np

from benchmarks.experiments.edges.true_layers import BLUR, Scene, clutter, planes
from bokehnet import rays
from bokehnet.baselines.rays.image_based_rays import trace_height_fields
from bokehnet.baselines.rays.umbra import cull_umbra
from bokehnet.classical.known_layers import Layers
from bokehnet.optics.coc import defocus_from_disparity
from train.scores.metrics import compare

_SAMPLES = 64


def _layers(scene: Scene) -> tuple[Layers, Layers]:
    """Return the surfaces along the rays through the pixel centres, and the first surface only."""
    colors, values, coverage = scene.layers["cut hard"]
    radii = np.minimum.accumulate(BLUR * (values - scene.focus), 2)
    whole = Layers(colors=colors, defocus=radii, coverage=(coverage >= 0.5).astype(np.float32))
    first_index = whole.coverage.argmax(2)[..., None]  # the first opaque one
    first = Layers(
        colors=np.take_along_axis(colors, first_index[..., None], 2),
        defocus=np.take_along_axis(radii, first_index, 2),
        coverage=np.take_along_axis(whole.coverage, first_index, 2),
    )
    return whole, first


def print_scene(name: str, scene: Scene) -> None:
    """Print the rows of one scene."""
    defocus = defocus_from_disparity(scene.disparity, BLUR, scene.focus).astype(np.float32)
    whole, first = _layers(scene)
    culled = {
        label: cull_umbra(whole, extended=extended)
        for label, extended in (("umbra", False), ("extended", True))
    }
    behind = whole.coverage[:, :, 1:].sum()
    for label, layers in (("none", whole), *culled.items()):
        removed = 1 - layers.coverage[:, :, 1:].sum() / behind
        needed = np.quantile(layers.coverage.sum(2), 0.999)
        mean = layers.coverage.sum(2).mean()
        layered = f"{mean:5.2f} layers a pixel, {needed:.0f} for 99.9 %"
        print(f"{name:10s} culled by {label:9s} {removed:7.1%} gone, {layered}")
    variants = [
        ("one layer, edges", first, {}),
        ("edges", whole, {}),
        ("corners", whole, {"walk": "corners"}),
        ("edges, no bounds", whole, {"bounded": False}),
        ("corners, no bounds", whole, {"walk": "corners", "bounded": False}),
        ("edges, umbra", culled["umbra"], {}),
        ("edges, extended", culled["extended"], {}),
    ]
    small = Layers(**{key: getattr(whole, key)[:16, :16] for key in ("colors", "defocus", "coverage")})
    trace_height_fields(small, samples=4)
    for label, layers, options in variants:
        seconds = []
        for _ in range(3):
            start = process_time()
            bokeh, lost = trace_height_fields(layers, samples=_SAMPLES, **options)
            seconds.append(process_time() - start)
        score = compare(bokeh, scene.truth, defocus)["edge_psnr"]
        print(
            f"{name:10s} {label:20s}{min(seconds):7.2f} s{score:8.2f} dB{lost.mean():8.2%} lost", flush=True
        )
    result = compare(rays(scene.image.astype(np.float32), defocus, layers=whole), scene.truth, defocus)
    print(f"{name:10s} {'our rays':29s}{result['edge_psnr']:8.2f} dB", flush=True)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=1, help="number of scenes of each kind")
    count = parser.parse_args().scenes
    for make in (clutter, planes):
        for seed in range(1, count + 1):
            print_scene(f"{make.__name__} {seed}", make(seed))


if __name__ == "__main__":
    main()

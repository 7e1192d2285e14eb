"""Night scenes with small bright lamps, by rays with and without unmixing.

Run ``python -m benchmarks.experiments.looks.night``.

Draws scenes from seeds: dark objects on the ground with small lamps. The truth is traced through the lens,
    with rays aimed at the lamps. Prints, for three focus positions, PSNR at edges
    (:mod:`train.scores.metrics`) and PSNR of log(1 + light) over all pixels.
    :mod:`benchmarks.experiments.looks.lamps` measures the light conservation of single lamps. ``--save
    FOLDER`` saves the inputs and truths for other renderers.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.experiments.edges.depth_edges import without_unmixing
from bokehnet import rays
from bokehnet.lenses import ThinLens
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.optics.pixels.pixel_filter import PixelFilter
from bokehnet.synth import ClutterConfig, SynthConfig
from bokehnet.synth.clutter.baked_scene import View
from bokehnet.synth.clutter.lamps import add_lamps
from bokehnet.synth.clutter.scenes import Clutter, random_clutter
from bokehnet.synth.pairs import lens_for_view
from train.scores.metrics import compare, psnr

_BLUR, _MAX_DISPARITY = 24.0, 0.85
_FOCI = {"near": 0.8, "middle": 0.45, "far": 0.1}
# Mean light without the lamps.
_MEAN_LIGHT = 0.02
_IMAGE_SAMPLES, _TRUTH_SAMPLES = 64, 1024
_BOX = PixelFilter("box", 1)

_CONFIG = SynthConfig(
    seed=1,
    scenes=1,
    width=256,
    height=192,
    bokeh_samples=1,
    image_samples=1,
    clutter=ClutterConfig(lamp_probability=1.0, thin_probability=0.5),
)


def traced(clutter: Clutter, lens: ThinLens, samples: int, gain: float, pupil: bool) -> np.ndarray:
    """Return the scene scaled by ``gain`` with unscaled lamps, (H, W, 3)."""
    view = View(
        width=_CONFIG.width, height=_CONFIG.height, pixel_pitch=_CONFIG.pixel_pitch, samples=samples, seed=1
    )
    picture = gain * clutter.scene.render(lens, view, pupil)
    add_lamps(picture, clutter.scene, clutter.lamps, lens, view, pupil)
    return picture


def nights(seed: int) -> Iterator[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Yield name of the focus, picture, defocus and truth of a scene."""
    clutter = random_clutter(np.random.default_rng(seed), _CONFIG)
    pinhole = ThinLens(focal_length=_CONFIG.sensor_distance, f_number=1.0)
    view = View(
        width=_CONFIG.width, height=_CONFIG.height, pixel_pitch=_CONFIG.pixel_pitch, samples=1, seed=0
    )
    gain = _MEAN_LIGHT / float(clutter.scene.render(pinhole, view, False).mean())
    inverse = clutter.scene.disparity(pinhole, view)
    nearest = _MAX_DISPARITY / float(inverse.max())
    image = traced(clutter, pinhole, _IMAGE_SAMPLES, gain, False).astype(np.float32)
    for focus_name, focus in _FOCI.items():
        lens = lens_for_view(_BLUR, focus, replace(_CONFIG, nearest_distance=nearest))
        defocus = defocus_from_disparity(nearest * inverse, _BLUR, focus).astype(np.float32)
        yield focus_name, image, defocus, traced(clutter, lens, _TRUTH_SAMPLES, gain, True)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=4)
    parser.add_argument("--save", type=Path, help="folder for pictures, defocus and truth as .npz files")
    arguments = parser.parse_args()
    print("scene | focus | rays | edge PSNR | PSNR of log")
    print("---|---|---|---|---")
    scores: dict[str, list[tuple[float, ...]]] = {}
    for seed in range(1, arguments.scenes + 1):
        for focus_name, image, defocus, truth in nights(seed):
            if arguments.save:
                arguments.save.mkdir(parents=True, exist_ok=True)
                np.savez(
                    arguments.save / f"{seed}_{focus_name}.npz", image=image, defocus=defocus, truth=truth
                )
            with without_unmixing():
                whole = rays(image, defocus)
            for label, picture in {
                "whole": whole,
                "unmixed": rays(image, defocus, pixel_filter=_BOX),
            }.items():
                squared = (np.log1p(np.maximum(picture, 0)) - np.log1p(truth)) ** 2
                row = compare(picture, truth, defocus)["edge_psnr"], psnr(squared)
                scores.setdefault(label, []).append(row)
                print(f"{seed} | {focus_name} | {label} | {row[0]:.2f} | {row[1]:.2f}", flush=True)
    for label, rows in scores.items():
        edge, log_psnr = np.mean(rows, 0)
        print(f"mean | | {label} | {edge:.2f} | {log_psnr:.2f}")


if __name__ == "__main__":
    main()

"""Looks fitted to pairs of path-traced pictures, sharp and blurred, with a known camera.

python -m benchmarks.experiments.looks.pair_fit FOLDER [--shots 2] [--blades 0,5,6,7,8,9]

FOLDER holds scenes as for ``python -m benchmarks.quality.cycles``.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from bokehnet import MetricDepth, read_scene
from bokehnet.io.image import read_image
from bokehnet.tools.pair_fit import fit_pair


def main() -> None:
    """Print relative errors of blur and focus, and the fitted aperture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shots", type=int, nargs="+", default=[2, 4])
    parser.add_argument("--blades", default="0,5,6,7,8,9")
    options = parser.parse_args()
    blades = [int(number) for number in options.blades.split(",")]
    print("scene | shot | blades | found | blur off, % | focus off, % of the map | rim | cat's-eye | left")
    print("---|---|---|---|---|---|---|---|---")
    for path in sorted(options.folder.glob("*/scene.json")):
        description = json.loads(path.read_text())
        source = MetricDepth(map=path.parent / "depth.exr")
        image = read_image(path.parent / "image.exr")
        scene = read_scene(path.parent / "image.exr", source=source)
        disparity = 1000 * np.asarray(scene.depth.values, float)  # per metre
        for number in options.shots:
            shot = description["shots"][number]
            focal, focus = description["focal_length_mm"] / 1000, shot["focus_distance_m"]
            blur = 0.5 * focal**2 / shot["f_number"] * focus / (focus - focal)
            blur *= description["width"] / description["sensor_width_mm"] * 1000
            if shot["blades"]:  # radius of a disc of the same area
                angle = np.pi / shot["blades"]
                blur *= np.sqrt(shot["blades"] * np.sin(angle) * np.cos(angle) / np.pi)
            fit = fit_pair(image, disparity, read_image(path.parent / shot["file"]), blades=blades)
            disparity_range = disparity.max() - disparity.min()
            print(
                f"{description['scene']} | {number} | {shot['blades']} | {fit.look.blades} | "
                f"{100 * (fit.blur / blur - 1):.1f} | "
                f"{100 * (fit.focus - 1 / focus) / disparity_range:.2f} | "
                f"{fit.look.spherical_profile:.2f} | {fit.look.cats_eye:.2f} | {fit.residual:.4f}",
                flush=True,
            )


if __name__ == "__main__":
    main()

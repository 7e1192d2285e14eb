"""Quality on path-traced scenes of an independent renderer: ``python -m benchmarks.cycles FOLDER``.

FOLDER holds one folder a scene with ``image.exr``, ``depth.exr``, ``scene.json`` and the truth of every
shot. PSNR and SSIM are those of :mod:`train.metrics`.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.quality import Engine, Shot, print_header, print_scores, score
from bokehnet.inference.pipeline import ENGINES, BokehRenderer
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_depth
from bokehnet.lenses import ThinLens, defocus_map
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.coc import disparity_from_depth

__all__ = ["read_shots", "scene_folders", "whole_engine"]


def scene_folders(folder: Path) -> list[Path]:
    """Scenes below ``folder``, by name."""
    return sorted(path.parent for path in folder.glob("*/scene.json"))


def read_shots(folder: Path) -> Iterator[Shot]:
    """Every shot of one scene."""
    scene = json.loads((folder / "scene.json").read_text())
    image, depth = read_image(folder / "image.exr"), read_depth(folder / "depth.exr")
    for shot in scene["shots"]:
        lens = ThinLens(
            focal_length=scene["focal_length_mm"],
            f_number=shot["f_number"],
            focus_distance=1000 * shot["focus_distance_m"],
        )
        defocus = defocus_map(disparity_from_depth(depth), lens, scene["sensor_width_mm"] / scene["width"])
        yield Shot(
            image=image,
            defocus=defocus,
            truth=read_image(folder / shot["file"]),
            aperture=Aperture(blades=shot["blades"], rotation=shot["blade_rotation_deg"]),
        )


def whole_engine(name: str, weights: Path | None = None) -> Engine:
    """The engine that people use; the hybrid knows no aperture but the disc."""

    def render(image: np.ndarray, defocus: np.ndarray, *, aperture: Aperture) -> np.ndarray:
        shape = Aperture() if name == "hybrid" else aperture
        return BokehRenderer(name, aperture=shape, weights=weights).render(image, defocus).bokeh

    return render


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--weights", type=Path)
    arguments = parser.parse_args()
    engines = {name: whole_engine(name, arguments.weights) for name in ENGINES}
    print_header("scene")
    everything = []
    for folder in scene_folders(arguments.folder):
        rows = score(read_shots(folder), engines)
        everything += rows
        print_scores(folder.name, rows)
        print_scores("all so far", everything)


if __name__ == "__main__":
    main()

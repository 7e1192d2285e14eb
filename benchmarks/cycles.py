"""Quality on path-traced scenes of an independent renderer: ``python -m benchmarks.cycles FOLDER``.

FOLDER holds one folder a scene with ``image.exr``, ``depth.exr``, ``scene.json`` and the truth of every
shot. PSNR and SSIM are those of :mod:`train.metrics`.
"""

import argparse
import json
from pathlib import Path

from bokehnet.inference.pipeline import ENGINES, BokehRenderer
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_depth
from bokehnet.lenses import ThinLens, defocus_map
from bokehnet.optics.coc import disparity_from_depth
from train.metrics import compare, mean_scores


def score_scene(folder: Path, renderers: dict[str, BokehRenderer]) -> list[dict[str, float]]:
    """Scores of every shot, keyed ``engine/score``."""
    scene = json.loads((folder / "scene.json").read_text())
    image, depth = read_image(folder / "image.exr"), read_depth(folder / "depth.exr")
    rows = []
    for shot in scene["shots"]:
        lens = ThinLens(
            focal_length=scene["focal_length_mm"],
            f_number=shot["f_number"],
            focus_distance=1000 * shot["focus_distance_m"],
        )
        defocus = defocus_map(disparity_from_depth(depth), lens, scene["sensor_width_mm"] / scene["width"])
        truth = read_image(folder / shot["file"])
        row = {}
        for name, renderer in renderers.items():
            scores = compare(renderer.render(image, defocus).bokeh, truth, defocus)
            row |= {f"{name}/{key}": value for key, value in scores.items()}
        rows.append(row)
    return rows


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--weights", type=Path)
    arguments = parser.parse_args()
    renderers = {engine: BokehRenderer(engine, weights=arguments.weights) for engine in ENGINES}
    columns = ("psnr", "ssim", "edge_psnr", "edge_ssim")
    print(f"{'scene':22s}{'engine':10s}" + "".join(f"{column:>11s}" for column in columns))
    everything = []
    for folder in sorted(path.parent for path in arguments.folder.glob("*/scene.json")):
        rows = score_scene(folder, renderers)
        everything += rows
        for label, some in ((folder.name, rows), ("all so far", everything)):
            scores = mean_scores(some)
            for name in renderers:
                values = "".join(f"{scores[f'{name}/{column}']:11.4f}" for column in columns)
                print(f"{label:22s}{name:10s}{values}")


if __name__ == "__main__":
    main()

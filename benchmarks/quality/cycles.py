"""Quality on path-traced scenes of an independent renderer: ``python -m benchmarks.quality.cycles FOLDER``.

FOLDER holds scenes in the layout of :func:`train.scores.evaluation_sets.path_traced_pictures`. PSNR and SSIM
are those of :mod:`train.scores.metrics`; ``python -m train.evaluate`` prints more scores.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.figures import write_figures
from benchmarks.quality.tables.score_table import Engine, print_header, print_scores, score
from bokehnet.engine_registry import ENGINES
from bokehnet.inference.session import WEIGHTS
from bokehnet.optics.aperture import Aperture
from train.scores.evaluation_sets import path_traced_shots as read_shots
from train.scores.evaluation_sets import scene_folders
from train.scores.methods import Method
from train.scores.metrics import mean_scores

_COLUMNS = {
    "psnr": ("PSNR", ".2f"),
    "ssim": ("SSIM", ".3f"),
    "edge_psnr": ("edge PSNR", ".2f"),
    "edge_ssim": ("edge SSIM", ".3f"),
}

__all__ = ["read_shots", "scene_folders", "whole_engine"]


def whole_engine(name: str, weights: Path | None = None) -> Engine:
    """Return the complete engine of a name."""
    method = Method(name=name, engine=name, weights=weights)

    def render(image: np.ndarray, defocus: np.ndarray, *, aperture: Aperture) -> np.ndarray:
        return method.render(image, defocus, aperture).bokeh

    return render


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--weights", type=Path, default=WEIGHTS, help="folder with a folder for each engine with networks"
    )
    parser.add_argument("--figures", type=Path, help="JSON file for the tables of the documentation")
    arguments = parser.parse_args()
    engines = {
        name: whole_engine(name, arguments.weights / spec.networks if spec.networks else None)
        for name, spec in ENGINES.items()
    }
    print_header("scene")
    everything = []
    for folder in scene_folders(arguments.folder):
        rows = score(read_shots(folder), engines)
        everything += rows
        print_scores(folder.name, rows)
        print_scores("all so far", everything)
    if arguments.figures:
        means = {name: mean_scores([row[name] for row in everything]) for name in engines}
        conditions = (
            f"{len(everything)} path-traced pictures, true depth, dB and SSIM of the clipped sRGB picture"
        )
        write_figures(
            arguments.figures, "python -m benchmarks.quality.cycles FOLDER", conditions, _COLUMNS, means
        )


if __name__ == "__main__":
    main()

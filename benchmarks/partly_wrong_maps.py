"""Maps that are right in one half: ``python -m benchmarks.partly_wrong_maps FOLDER [--shots 2]``.

FOLDER holds path-traced scenes as :func:`train.evaluation_sets.path_traced_pictures` reads them. The left
half of the true map is degraded as :mod:`train.degradation` does; rays with the map as it is, repaired
everywhere and by ``auto``. Edge PSNR in dB.
"""

import argparse
from itertools import islice
from pathlib import Path

import numpy as np

from bokehnet.classical.rays_renderer import rays
from bokehnet.inference.disparity_repair import DisparityRepair, RepairMode
from train.degradation import DEGRADED, degrade
from train.evaluation_sets import path_traced_shots, scene_folders
from train.metrics import compare

WAYS: tuple[RepairMode, ...] = ("off", "on", "auto")


def half_wrong(values: np.ndarray, kind: str) -> np.ndarray:
    """A map (H, W) of which the left half is degraded."""
    left = np.arange(values.shape[1]) < values.shape[1] // 2
    return np.where(left, degrade(values, kind), values)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shots", type=int, default=2, help="of each scene, from the first on")
    arguments = parser.parse_args()
    repair = DisparityRepair()
    everything = []
    print(f"{'scene':20s}{'half':10s}" + "".join(f"{way:>8s}" for way in WAYS))
    for folder in scene_folders(arguments.folder):
        shots = list(islice(path_traced_shots(folder), arguments.shots))
        for kind in DEGRADED:
            rows = []
            for shot in shots:
                wrong = half_wrong(shot.defocus, kind)
                maps = [repair(shot.image, wrong, way) for way in WAYS]
                renders = [rays(shot.image, values, aperture=shot.aperture) for values in maps]
                rows.append([compare(render, shot.truth, shot.defocus)["edge_psnr"] for render in renders])
            everything += rows
            print(f"{folder.name:20s}{kind:10s}" + "".join(f"{x:8.2f}" for x in np.mean(rows, 0)), flush=True)
    print(f"{'mean':30s}" + "".join(f"{x:8.2f}" for x in np.mean(everything, 0)))


if __name__ == "__main__":
    main()

"""Edge PSNR of maps as they are, repaired everywhere, and where they are wrong, on path-traced scenes."""

import argparse
from collections.abc import Callable, Mapping
from itertools import islice
from pathlib import Path

import numpy as np

from bokehnet.classical.rays_renderer import rays
from bokehnet.depth_repair.repair import DisparityRepair, RepairMode
from train.evaluation_sets import path_traced_shots, scene_folders
from train.metrics import compare

__all__ = ["print_repairs"]

_MODES: tuple[RepairMode, ...] = ("off", "on", "auto")


def print_repairs(description: str | None, kinds: Mapping[str, Callable[[np.ndarray], np.ndarray]]) -> None:
    """Read the command line; print a row for each scene and kind of wrong map, and the mean of all.

    Args:
        description: Of the benchmark, for its help.
        kinds: What makes a right map (H, W) a wrong one, by name.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shots", type=int, default=2, help="of each scene, from the first on")
    arguments = parser.parse_args()
    repair, everything = DisparityRepair(), []
    print(f"{'scene':20s}{'map':15s}" + "".join(f"{mode:>8s}" for mode in _MODES))
    for scene in scene_folders(arguments.folder):
        read = list(islice(path_traced_shots(scene), arguments.shots))
        for kind, spoil in kinds.items():
            rows = []
            for shot in read:
                wrong = spoil(shot.defocus)
                maps = [repair(shot.image, wrong, mode) for mode in _MODES]
                renders = [rays(shot.image, values, aperture=shot.aperture) for values in maps]
                rows.append([compare(render, shot.truth, shot.defocus)["edge_psnr"] for render in renders])
            everything += rows
            print(f"{scene.name:20s}{kind:15s}" + "".join(f"{x:8.2f}" for x in np.mean(rows, 0)), flush=True)
    print(f"{'mean':35s}" + "".join(f"{x:8.2f}" for x in np.mean(everything, 0)))

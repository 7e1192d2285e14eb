"""Edge PSNR of maps as they are, repaired everywhere, and where they are wrong, on path-traced scenes."""

from collections.abc import Callable, Mapping
from itertools import islice
from pathlib import Path

import numpy as np

from bokehnet.classical.rays_renderer import rays
from bokehnet.inference.disparity_repair import DisparityRepair, RepairMode
from train.evaluation_sets import path_traced_shots, scene_folders
from train.metrics import compare

__all__ = ["print_repairs"]

_MODES: tuple[RepairMode, ...] = ("off", "on", "auto")


def print_repairs(folder: Path, shots: int, kinds: Mapping[str, Callable[[np.ndarray], np.ndarray]]) -> None:
    """Print a row for each scene and kind of wrong map, and the mean of all.

    Args:
        folder: Scenes as :func:`train.evaluation_sets.path_traced_pictures` reads them.
        shots: Of each scene, from the first on.
        kinds: What makes a right map (H, W) a wrong one, by name.
    """
    repair, everything = DisparityRepair(), []
    print(f"{'scene':20s}{'map':14s}" + "".join(f"{mode:>8s}" for mode in _MODES))
    for scene in scene_folders(folder):
        read = list(islice(path_traced_shots(scene), shots))
        for kind, spoil in kinds.items():
            rows = []
            for shot in read:
                wrong = spoil(shot.defocus)
                maps = [repair(shot.image, wrong, mode) for mode in _MODES]
                renders = [rays(shot.image, values, aperture=shot.aperture) for values in maps]
                rows.append([compare(render, shot.truth, shot.defocus)["edge_psnr"] for render in renders])
            everything += rows
            print(f"{scene.name:20s}{kind:14s}" + "".join(f"{x:8.2f}" for x in np.mean(rows, 0)), flush=True)
    print(f"{'mean':34s}" + "".join(f"{x:8.2f}" for x in np.mean(everything, 0)))

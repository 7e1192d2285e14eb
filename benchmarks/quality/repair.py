"""Edge PSNR of faulty maps by repair: ``python -m benchmarks.quality.repair FOLDER [--faults moved]``.

FOLDER holds path-traced scenes in the layout of :func:`train.scores.evaluation_sets.path_traced_shots`. Each
fault is applied to the true map; the rays render it unrepaired, repaired everywhere and by ``auto``. Edge
PSNR in dB.
"""

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from bokehnet.classical.rays_renderer import rays
from bokehnet.depth_repair.edge_bias import shift_edges
from bokehnet.depth_repair.map_offset import translate_map
from bokehnet.depth_repair.repair import DisparityRepair, RepairMode
from train.data.degradation import DEGRADED, degrade
from train.scores.evaluation_sets import path_traced_shots, scene_folders
from train.scores.metrics import compare

__all__ = ["FAULTS"]

_MODES: tuple[RepairMode, ...] = ("off", "on", "auto")

Fault = Callable[[np.ndarray], np.ndarray]


def grown(values: np.ndarray, pixels: int, blur: float) -> np.ndarray:
    """Return a map (H, W) with foregrounds larger by ``pixels``, blurred (sigma ``blur`` pixels)."""
    result = shift_edges(values, pixels)
    return gaussian_filter(result, blur) if blur else result


def moved(values: np.ndarray, offset: tuple[int, int], blur: float) -> np.ndarray:
    """Return a map (H, W) moved down and right by ``offset`` pixels and blurred (sigma ``blur`` pixels)."""
    result = translate_map(values, offset)
    return gaussian_filter(result, blur) if blur else result


def noisy(values: np.ndarray, level: float) -> np.ndarray:
    """Return a map (H, W) with Gaussian noise whose deviation is ``level`` times the range of the map."""
    noise = np.random.default_rng(0).standard_normal(values.shape)
    return (values + level * np.ptp(values) * noise).astype(np.float32)


def half_wrong(values: np.ndarray, kind: str) -> np.ndarray:
    """Return a map (H, W) whose left half is degraded by a kind of :mod:`train.data.degradation`."""
    left = np.arange(values.shape[1]) < values.shape[1] // 2
    return np.where(left, degrade(values, kind), values)


FAULTS: Mapping[str, Mapping[str, Fault]] = {
    "grown": {
        f"{pixels:+d} px, blur {blur}": partial(grown, pixels=pixels, blur=blur)
        for pixels, blur in ((0, 0.0), (2, 1.0), (2, 3.0), (3, 2.0), (-2, 1.0), (-2, 3.0))
    },
    "moved": {
        f"{down:+d}, {right:+d} px, blur {blur}": partial(moved, offset=(down, right), blur=blur)
        for down, right, blur in (
            (0, 0, 0.0),
            (0, 1, 0.0),
            (0, -2, 0.0),
            (0, 4, 0.0),
            (-3, 2, 0.0),
            (0, -2, 2.0),
        )
    },
    "noisy": {f"noise {100 * level:g} %": partial(noisy, level=level) for level in (0.0, 0.005, 0.01, 0.03)},
    "half": {f"half {kind}": partial(half_wrong, kind=kind) for kind in DEGRADED},
}


def main() -> None:
    """Print a row per scene and fault, and the mean of all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--faults", choices=FAULTS, action="append", help="default: all")
    parser.add_argument("--shots", type=int, default=2, help="number of shots per scene, from the first")
    arguments = parser.parse_args()
    repair, everything = DisparityRepair(), []
    print(f"{'scene':20s}{'map':22s}" + "".join(f"{mode:>8s}" for mode in _MODES))
    for scene in scene_folders(arguments.folder):
        shots = list(islice(path_traced_shots(scene), arguments.shots))
        for group in arguments.faults or FAULTS:
            for name, apply_fault in FAULTS[group].items():
                rows = []
                for shot in shots:
                    faulty = apply_fault(shot.defocus)
                    maps = [repair(shot.image, faulty, mode) for mode in _MODES]
                    renders = [rays(shot.image, values, aperture=shot.aperture) for values in maps]
                    rows.append(
                        [compare(render, shot.truth, shot.defocus)["edge_psnr"] for render in renders]
                    )
                everything += rows
                print(
                    f"{scene.name:20s}{name:22s}" + "".join(f"{x:8.2f}" for x in np.mean(rows, 0)), flush=True
                )
    print(f"{'mean':42s}" + "".join(f"{x:8.2f}" for x in np.mean(everything, 0)))


if __name__ == "__main__":
    main()

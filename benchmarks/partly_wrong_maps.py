"""Maps that are right in one half: ``python -m benchmarks.partly_wrong_maps FOLDER [--shots 2]``.

FOLDER holds path-traced scenes as :func:`train.evaluation_sets.path_traced_pictures` reads them. The left
half of the true map is degraded as :mod:`train.degradation` does; rays with the map as it is, repaired
everywhere and by ``auto``. Edge PSNR in dB.
"""

from functools import partial

import numpy as np

from benchmarks.repair_table import print_repairs
from train.degradation import DEGRADED, degrade


def half_wrong(values: np.ndarray, kind: str) -> np.ndarray:
    """A map (H, W) of which the left half is degraded."""
    left = np.arange(values.shape[1]) < values.shape[1] // 2
    return np.where(left, degrade(values, kind), values)


def main() -> None:
    """Entry of the command line."""
    kinds = {f"half {kind}": partial(half_wrong, kind=kind) for kind in DEGRADED}
    print_repairs(__doc__, kinds)


if __name__ == "__main__":
    main()

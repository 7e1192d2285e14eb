"""Maps with noise in every pixel: ``python -m benchmarks.noisy_maps FOLDER [--shots 2]``.

FOLDER holds path-traced scenes as :func:`train.evaluation_sets.path_traced_pictures` reads them. Normal noise
is added to the true map; rays with the map as it is, repaired everywhere and by ``auto``. Edge PSNR in dB;
the first row of each scene is the true map.
"""

from functools import partial

import numpy as np

from benchmarks.repair_table import print_repairs

# Deviations, as shares of the map's range.
LEVELS = (0.0, 0.005, 0.01, 0.03)


def noisy(values: np.ndarray, level: float) -> np.ndarray:
    """A map (H, W) with noise."""
    noise = np.random.default_rng(0).standard_normal(values.shape)
    return (values + level * np.ptp(values) * noise).astype(np.float32)


def main() -> None:
    """Entry of the command line."""
    print_repairs(__doc__, {f"{100 * level:g} %": partial(noisy, level=level) for level in LEVELS})


if __name__ == "__main__":
    main()

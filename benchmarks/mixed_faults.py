"""Maps with two faults, as networks make them: ``python -m benchmarks.mixed_faults FOLDER [--shots 2]``.

FOLDER holds path-traced scenes as :func:`train.evaluation_sets.path_traced_pictures` reads them. Near things
of the true map grow or shrink by some pixels, then it is blurred; rays with the map as it is, repaired
everywhere and by ``auto``. Edge PSNR in dB; the first row of each scene is the true map.
"""

from functools import partial

import numpy as np
from scipy.ndimage import gaussian_filter

from benchmarks.repair_table import print_repairs
from bokehnet.depth_repair.edge_bias import shift_edges

# Pixels by which near things grow, negative where they shrink, and the deviation of the blur, pixels.
KINDS = {
    "true": (0, 0.0),
    "2 more, blur 1": (2, 1.0),
    "2 more, blur 3": (2, 3.0),
    "3 more, blur 2": (3, 2.0),
    "2 less, blur 1": (-2, 1.0),
    "2 less, blur 3": (-2, 3.0),
}


def spoilt(values: np.ndarray, pixels: int, deviation: float) -> np.ndarray:
    """A map (H, W), with larger or smaller things and blurred."""
    result = shift_edges(values, pixels)
    return gaussian_filter(result, deviation) if deviation else result


def main() -> None:
    """Entry of the command line."""
    kinds = {name: partial(spoilt, pixels=pixels, deviation=sigma) for name, (pixels, sigma) in KINDS.items()}
    print_repairs(__doc__, kinds)


if __name__ == "__main__":
    main()

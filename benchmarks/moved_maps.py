"""Maps that lie beside their picture: ``python -m benchmarks.moved_maps FOLDER [--shots 2]``.

FOLDER holds path-traced scenes as :func:`train.evaluation_sets.path_traced_pictures` reads them. The true map
is moved by some pixels, as a whole; blurred besides; rays with the map as it is, repaired everywhere and by
``auto``. Edge PSNR in dB; the first row of each scene is the true map.
"""

from functools import partial

import numpy as np
from scipy.ndimage import gaussian_filter

from benchmarks.repair_table import print_repairs
from bokehnet.depth_repair.map_offset import move_map

# Pixels down and to the right, and the deviation of the blur, pixels.
KINDS = {
    "true": ((0, 0), 0.0),
    "1 right": ((0, 1), 0.0),
    "2 left": ((0, -2), 0.0),
    "4 right": ((0, 4), 0.0),
    "3 up 2 right": ((-3, 2), 0.0),
    "2 left, soft": ((0, -2), 2.0),
}


def moved(values: np.ndarray, offset: tuple[int, int], deviation: float) -> np.ndarray:
    """A map (H, W), moved and blurred."""
    result = move_map(values, offset)
    return gaussian_filter(result, deviation) if deviation else result


def main() -> None:
    """Entry of the command line."""
    kinds = {name: partial(moved, offset=offset, deviation=sigma) for name, (offset, sigma) in KINDS.items()}
    print_repairs(__doc__, kinds)


if __name__ == "__main__":
    main()

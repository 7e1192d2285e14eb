"""Picture of grinding and polishing: ``python -m benchmarks.experiments.theses.polishing_picture FILE``.

Thesis 000, 3.4: the normal map of a surface above, its slopes along x and y in red and green, and below the
image of a blurred point through it; columns are heights of the grooves.
"""

import argparse
from pathlib import Path

import numpy as np

from bokehnet.io.image import write_image
from bokehnet.lenses.aberrations.polishing import PolishedSurface, polished_psf
from bokehnet.tools.contact_sheet import contact_sheet

_HEIGHTS_NM, _SIZE_PX, _BLUR_PX = (0.0, 5.0, 15.0, 30.0), 192, 90.0

# Slope that is fully red or green.
_FULL_SLOPE = 4e-4


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, help="output file")
    maps, blurs = [], []
    for height in _HEIGHTS_NM:
        surface = PolishedSurface(ring_height=height, wander=0.15)
        slopes = surface.slopes()
        step = len(slopes) // _SIZE_PX
        start = (len(slopes) - step * _SIZE_PX) // 2
        coarse = slopes[start : start + step * _SIZE_PX, start : start + step * _SIZE_PX]
        coarse = coarse.reshape(_SIZE_PX, step, _SIZE_PX, step, 2).mean((1, 3))
        normal = np.concatenate([0.5 + coarse / (2 * _FULL_SLOPE), np.ones((_SIZE_PX, _SIZE_PX, 1))], -1)
        maps.append((f"grooves of {height:g} nm", np.clip(normal, 0, 1).astype(np.float32)))
        psf = polished_psf(surface, _BLUR_PX, 0.002, 60.0)
        half, middle = _SIZE_PX // 2, len(psf) // 2
        pad = np.zeros((_SIZE_PX, _SIZE_PX))
        reach = min(half, middle)
        pad[half - reach : half + reach, half - reach : half + reach] = psf[
            middle - reach : middle + reach, middle - reach : middle + reach
        ]
        light = 0.5 * pad * np.pi * _BLUR_PX**2
        blurs.append(("blurred point", np.repeat(light[..., None], 3, 2).astype(np.float32)))
    write_image(parser.parse_args().file, contact_sheet([maps, blurs]))


if __name__ == "__main__":
    main()

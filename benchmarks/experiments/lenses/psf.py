"""Point spread functions of catalog lenses: aberration maps compared with rays through the glass.

Run ``python -m benchmarks.experiments.lenses.psf``.
"""

import argparse
from pathlib import Path

import numpy as np

from bokehnet.lenses import load_lens
from bokehnet.lenses.aberrations.aberration_fit import aberration_misfit, fit_aberration_map
from bokehnet.lenses.aberrations.point_spread import correlation
from bokehnet.lenses.aberrations.psf_pairs import PsfPair, psf_pairs
from bokehnet.tools.psf_sheet import write_psf_sheet

__all__ = ["main"]

_LENSES = ("cooke_triplet", "double_gauss", "petzval", "retrofocus")
# Focus distance in focal lengths, and pixels per half diagonal: a picture of 1600 x 1200.
_FOCUS, _PIXELS = 30.0, 1000


def _print_pair(name: str, pair: PsfPair) -> list[float]:
    """Print one line; return the correlations of all colours, and of each."""
    correlations = [pair.correlation]
    correlations += [correlation(pair.traced[..., c], pair.reduced[..., c]) for c in range(3)]
    columns = "".join(f"{value:8.4f}" for value in correlations)
    print(
        f"{name:15s}{pair.depth / 1000:8.3g}{pair.field:7.1f}{_PIXELS * pair.blur_radius:9.1f}"
        f"{_PIXELS * pair.width:9.1f}{columns}",
        flush=True,
    )
    return correlations


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lenses", nargs="+", default=_LENSES)
    parser.add_argument("--sheets", type=Path, help="folder for a contact sheet of each lens")
    arguments = parser.parse_args()
    print(
        f"pixels of a picture with a half diagonal of {_PIXELS}; wide open, focus at {_FOCUS:g} focal lengths"
    )
    header = "".join(f"{column:>8s}" for column in ("colours", "red", "green", "blue"))
    print(f"{'lens':15s}{'depth,m':>8s}{'field':>7s}{'radius':>9s}{'width':>9s}{header}")
    all_correlations: list[list[float]] = []
    for name in arguments.lenses:
        lens = load_lens(name, focus_distance=_FOCUS * load_lens(name).focal_length)
        aberration_map = fit_aberration_map(lens)
        if arguments.sheets is None:
            pairs = list(psf_pairs(lens, aberration_map))
        else:
            arguments.sheets.mkdir(parents=True, exist_ok=True)
            pairs = write_psf_sheet(lens, arguments.sheets / f"psf_{name}.png")
        all_correlations += [_print_pair(name, pair) for pair in pairs]
        misfits = [aberration_misfit(lens, aberration_map, wavelength=nm)[0] for nm in (450.0, 546.07, 650.0)]
        worst = _PIXELS * max(misfits)
        print(
            f"{name:15s}rms error of the fit, 450 to 650 nm: {worst:.3f} pixels; "
            f"{len(aberration_map.vignetting_apertures)} rims"
        )
    scores = np.array(all_correlations)
    means, worst_ones = ("".join(f"{v:8.4f}" for v in row) for row in (scores.mean(0), scores.min(0)))
    print(f"{'mean':48s}{means}\n{'worst':48s}{worst_ones}")


if __name__ == "__main__":
    main()

"""Profile textures compared with aberration maps: bytes, time and error.

Run ``python -m benchmarks.experiments.lenses.profile_textures``.

The error is 1 minus the correlation with the blur traced through the glass, mean over three depths, for
points on the axis, half way to the corner and near it. The time is that of one blur of 64 x 64 cells in 24
wavelengths, without the preparation of the lens, which has its own column.
"""

import argparse

from bokehnet.lenses import load_lens
from bokehnet.lenses.lookup.profile_comparison import compare_profiles

_LENSES = ("double_gauss", "petzval", "telephoto", "catadioptric")


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lenses", nargs="+", default=_LENSES)
    parser.add_argument(
        "--rays", type=int, default=6000, help="rays of each wavelength, for traced blurs and maps"
    )
    options = parser.parse_args()
    print("| lens | kind | bytes | made in, s | a blur in, ms | error on the axis | at 0.5 | at 0.9 |")
    print("|---|---|---|---|---|---|---|---|")
    for name in options.lenses:
        lens = load_lens(name, focus_distance=30 * load_lens(name).focal_length)
        for kind in compare_profiles(lens, rays=options.rays)[1]:
            errors = " | ".join(f"{error:.4f}" for error in kind.errors)
            row = f"{kind.name} | {kind.bytes} | {kind.build_seconds:.2f} | {1000 * kind.blur_seconds:.0f}"
            print(f"| {name} | {row} | {errors} |", flush=True)


if __name__ == "__main__":
    main()

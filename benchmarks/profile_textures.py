"""Profile textures beside aberration maps, bytes, time and error: ``python -m benchmarks.profile_textures``.

Error is one less the correlation with the blur traced through the glass, in the mean over three depths, for
points on the axis, half way to the corner and near it. Time is that of one blur of 64 x 64 cells in 24
wavelengths, without what is made once for the lens, which stands beside it.
"""

import argparse
import time

import numpy as np

from bokehnet.lenses import load_lens
from bokehnet.lenses.aberration_fit import fit_aberration_map
from bokehnet.lenses.point_spread import aberration_psf, correlation
from bokehnet.lenses.profile_texture import profile_psf, profile_row, trace_profile_texture
from bokehnet.lenses.psf_pairs import FIELDS, psf_pairs
from bokehnet.optics.wavelength_sampling import WavelengthSampling

_LENSES = ("double_gauss", "petzval", "telephoto", "catadioptric")
_SIZE, _WAVELENGTHS = 64, 24


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lenses", nargs="+", default=_LENSES)
    parser.add_argument(
        "--rays", type=int, default=6000, help="of each wavelength, for traced blurs and maps"
    )
    options = parser.parse_args()
    wavelengths, colors = WavelengthSampling().sample(_WAVELENGTHS)
    print("| lens | kind | bytes | made in, s | a blur in, ms | error on the axis | at 0.5 | at 0.9 |")
    print("|---|---|---|---|---|---|---|---|")
    for name in options.lenses:
        lens = load_lens(name, focus_distance=30 * load_lens(name).focal_length)
        half = lens.prescription.image_radius
        begin = time.process_time()
        found = fit_aberration_map(lens)
        made = [time.process_time() - begin]
        begin = time.process_time()
        texture = trace_profile_texture(lens)
        made.append(time.process_time() - begin)
        taken: list[list[float]] = [[], []]
        errors: dict[float, list[tuple[float, float]]] = {field: [] for field in FIELDS}
        for pair in psf_pairs(lens, found, options.rays):
            pitch = pair.width * half / _SIZE
            begin = time.process_time()
            rows = np.array([profile_row(texture, lens, pair.depth, float(nm)) for nm in wavelengths])
            shown = profile_psf(texture, rows, colors, pitch, _SIZE)
            taken[1].append(time.process_time() - begin)
            if pair.field == 0:
                begin = time.process_time()
                aberration_psf(
                    found,
                    defocus=pair.blur_radius,
                    field=(0.0, 0.0),
                    wavelengths=wavelengths,
                    colors=colors,
                    pitch=pitch / half,
                    size=_SIZE,
                    rays=options.rays,
                )
                taken[0].append(time.process_time() - begin)
            errors[pair.field].append((1 - pair.correlation, 1 - correlation(pair.traced, shown)))
        arrays = (found.wavelengths, found.transverse_aberration, found.pupil_aberration)
        sizes = [sum(array.nbytes for array in arrays) + 16 * len(found.vignetting_apertures), texture.size]
        for number, kind in enumerate(("aberration map", "profile texture")):
            told = [f"{np.mean([row[number] for row in errors[field]]):.4f}" for field in FIELDS]
            cells = [
                str(sizes[number]),
                f"{made[number]:.2f}",
                f"{1000 * np.median(taken[number]):.0f}",
                *told,
            ]
            print(f"| {name} | {kind} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()

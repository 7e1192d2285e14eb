"""Cost of lens responses: ``python -m benchmarks.experiments.looks.presets [SHARED]``.

Times each effect on picture 21 (1080x1350, maximum radius 39 px) with the engine ``rays``, relative to the
plain disc in alternation, on at most two cores; SHARED holds ``real/21.jpg`` with its disparity ``21.png``.
"""

import argparse
import statistics
from pathlib import Path

import numba

from benchmarks.classical import photograph
from benchmarks.measurement import in_own_process, time_in_turns
from bokehnet.classical.rays_renderer import rays
from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.catalog import load_lens
from bokehnet.lenses.seidel_lens import seidel_aberration_map
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling


def effects() -> dict[str, tuple[Aperture, LensResponse]]:
    """Return apertures and lens responses by name."""
    disc, plain = Aperture(), LensResponse()
    glass = {name: load_lens(name) for name in ("double_gauss", "petzval")}

    def sliders(**strengths: float) -> LensResponse:
        return LensResponse(aberration_map=AberrationSliders(**strengths).aberration_map())

    ideal = AberrationMap.perfect()
    tilted = AberrationMap(
        wavelengths=ideal.wavelengths,
        transverse_aberration=ideal.transverse_aberration,
        pupil_aberration=ideal.pupil_aberration,
        tilt=(0.0, 0.1),
    )
    fringes = ChromaticAberration(axial=0.5, lateral=0.5)
    return {
        "onion rings": (Aperture(onion=0.5), plain),
        "grain in discs": (Aperture(grain=0.3), plain),
        "spherical 0.5": (disc, sliders(spherical=0.5)),
        "coma 1": (disc, sliders(coma=1.0)),
        "astigmatism 1.5": (disc, sliders(astigmatism=1.5)),
        "field curvature 1": (disc, sliders(field_curvature=1.0)),
        "tilted focus plane": (disc, LensResponse(aberration_map=tilted)),
        "fringes, continuous": (disc, LensResponse(chromatic_aberration=fringes)),
        "fringes, rgb": (
            disc,
            LensResponse(
                chromatic_aberration=fringes, wavelength_sampling=WavelengthSampling(dispersion="rgb")
            ),
        ),
        "petzval, one colour": (
            disc,
            LensResponse(aberration_map=fit_aberration_map(glass["petzval"], wavelengths=())),
        ),
        "petzval, traced": (disc, LensResponse(aberration_map=fit_aberration_map(glass["petzval"]))),
        "double Gauss, traced": (
            disc,
            LensResponse(aberration_map=fit_aberration_map(glass["double_gauss"])),
        ),
        "double Gauss, Seidel": (
            disc,
            LensResponse(aberration_map=seidel_aberration_map(glass["double_gauss"])),
        ),
    }


def measure(shared: Path, threads: int, rounds: int) -> list[str]:
    """Return the lines of the table."""
    numba.set_num_threads(threads)
    image, defocus = photograph(shared)
    lines = []
    for name, (aperture, lens_response) in effects().items():
        runs = {
            "disc": lambda: rays(image, defocus),
            name: lambda aperture=aperture, lens_response=lens_response: rays(
                image, defocus, aperture=aperture, lens_response=lens_response
            ),
        }
        for run in runs.values():
            run()
        rows = time_in_turns(runs, rounds)
        seconds = statistics.median(row[name] for row in rows)
        ratio = statistics.median(row[name] / row["disc"] for row in rows)
        lines.append(f"{name:22s}{seconds:8.2f} s{ratio:9.2f}x")
    return lines


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("shared", type=Path, nargs="?", default=Path("../shared"), metavar="SHARED")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    threads = min(2, numba.config.NUMBA_NUM_THREADS)
    print(
        f"picture 21, rays, {threads} threads, medians of {arguments.rounds} rounds; "
        "relative to the plain disc"
    )
    print("\n".join(in_own_process(measure, arguments.shared, threads, arguments.rounds)))


if __name__ == "__main__":
    main()

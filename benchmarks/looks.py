"""What the character of a lens costs: ``python -m benchmarks.looks [SHARED]``.

Each effect on picture 21 (1080x1350, largest radius 39 px) by the engine ``rays``, as a multiple of the plain
disc in turns with it, on two cores at most; SHARED holds ``real/21.jpg`` with its disparity ``21.png``.
"""

import argparse
import statistics
from pathlib import Path

import numba

from benchmarks.classical import photograph
from benchmarks.measurement import in_own_process, time_in_turns
from bokehnet.classical.rays_renderer import rays
from bokehnet.lenses.catalog import load_lens
from bokehnet.lenses.pencil_fit import fit_pencil
from bokehnet.lenses.seidel_lens import seidel_pencil
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.character import Character
from bokehnet.optics.fringes import Fringes
from bokehnet.optics.light_draw import LightDraw
from bokehnet.optics.pencil import PencilMap
from bokehnet.optics.sliders import AberrationSliders


def effects() -> dict[str, tuple[Aperture, Character]]:
    """Openings and characters by name."""
    disc, plain = Aperture(), Character()
    glass = {name: load_lens(name) for name in ("double_gauss", "petzval")}

    def sliders(**strengths: float) -> Character:
        return Character(pencil=AberrationSliders(**strengths).pencil())

    nothing = PencilMap.perfect()
    leaning = PencilMap(
        wavelengths=nothing.wavelengths, miss=nothing.miss, bend=nothing.bend, tilt=(0.0, 0.1)
    )
    both = Fringes(axial=0.5, lateral=0.5)
    return {
        "onion rings": (Aperture(onion=0.5), plain),
        "grain in discs": (Aperture(grain=0.3), plain),
        "spherical 0.5": (disc, sliders(spherical=0.5)),
        "coma 1": (disc, sliders(coma=1.0)),
        "astigmatism 1.5": (disc, sliders(astigmatism=1.5)),
        "field curvature 1": (disc, sliders(field_curvature=1.0)),
        "focus plane leans": (disc, Character(pencil=leaning)),
        "fringes, continuous": (disc, Character(fringes=both)),
        "fringes, rgb": (disc, Character(fringes=both, light=LightDraw(dispersion="rgb"))),
        "petzval, one colour": (disc, Character(pencil=fit_pencil(glass["petzval"], wavelengths=()))),
        "petzval, traced": (disc, Character(pencil=fit_pencil(glass["petzval"]))),
        "double Gauss, traced": (disc, Character(pencil=fit_pencil(glass["double_gauss"]))),
        "double Gauss, Seidel": (disc, Character(pencil=seidel_pencil(glass["double_gauss"]))),
    }


def measure(shared: Path, threads: int, rounds: int) -> list[str]:
    """Lines of the table."""
    numba.set_num_threads(threads)
    image, defocus = photograph(shared)
    lines = []
    for name, (aperture, character) in effects().items():
        runs = {
            "disc": lambda: rays(image, defocus),
            name: lambda aperture=aperture, character=character: rays(
                image, defocus, aperture=aperture, character=character
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
    given = parser.parse_args()
    threads = min(2, numba.config.NUMBA_NUM_THREADS)
    print(f"picture 21, rays, {threads} threads, medians of {given.rounds} rounds; beside the plain disc")
    print("\n".join(in_own_process(measure, given.shared, threads, given.rounds)))


if __name__ == "__main__":
    main()

"""Cost and appearance of the camera effects.

Run ``python -m benchmarks.experiments.looks.effects [--sheet docs/images/effects.jpg]``.

Times each effect on picture 21 (1080x1350), relative to a plain render with its own map, in alternation on at
most two cores; then prints the error of a distortion and its inverse. ``--sheet`` instead writes a sheet of
the picture with each effect, exaggerated. SHARED holds ``real/21.jpg`` with its disparity ``21.png``.
"""

import argparse
import statistics
from pathlib import Path

import numba
import numpy as np

from benchmarks.classical import photograph
from benchmarks.measurement import in_own_process, time_in_turns
from bokehnet.effects import BrownConrady, CameraEffects, DivisionModel, Grain, Vignette
from bokehnet.io.image import write_image
from bokehnet.render.renderer import BokehRenderer
from bokehnet.tools.contact_sheet import contact_sheet

BARREL = DivisionModel(strength=-0.15)
BROWN = BrownConrady(radial=(-0.15, 0.02, 0.0), decentring=(0.002, -0.001))

TIMED = {
    "distortion": CameraEffects(distortion=BARREL),
    "distortion, Brown": CameraEffects(distortion=BROWN),
    "lateral": CameraEffects(lateral=0.004),
    "distortion and lateral": CameraEffects(distortion=BARREL, lateral=0.004),
    "cos^4": CameraEffects(cos4=40),
    "optical vignetting": CameraEffects(optical_vignetting=1.0),
    "vignette": CameraEffects(vignette=Vignette(stops=1.5)),
    "grain": CameraEffects(grain=Grain(iso=6400)),
    "grain of 4 px": CameraEffects(grain=Grain(iso=6400, size=4)),
    "all": CameraEffects(
        distortion=BARREL,
        lateral=0.004,
        cos4=40,
        optical_vignetting=1.0,
        vignette=Vignette(stops=1.5),
        grain=Grain(iso=6400),
    ),
}

SHOWN = {
    "blurred": CameraEffects(),
    "barrel -0.3": CameraEffects(distortion=DivisionModel(strength=-0.3)),
    "pincushion 0.3": CameraEffects(distortion=DivisionModel(strength=0.3)),
    "Brown -0.5, 0.6": CameraEffects(distortion=BrownConrady(radial=(-0.5, 0.6, 0.0))),
    "cos^4, 45 degrees": CameraEffects(cos4=45),
    "optical vignetting 1.2": CameraEffects(optical_vignetting=1.2),
    "vignette, 2 stops": CameraEffects(vignette=Vignette(stops=2.0)),
    "the same, round 0": CameraEffects(vignette=Vignette(stops=2.0, roundness=0.0)),
    "lateral 0.02, a part": CameraEffects(lateral=0.02),
    "grain 12800, a part": CameraEffects(grain=Grain(iso=12800)),
    "grey, 3 px, a part": CameraEffects(grain=Grain(iso=12800, size=3, monochrome=True)),
    "all together": CameraEffects(
        distortion=DivisionModel(strength=-0.12),
        lateral=0.006,
        cos4=35,
        optical_vignetting=1.0,
        vignette=Vignette(stops=0.7),
        grain=Grain(iso=6400),
    ),
}


REDUCTION = 3
CROP = (520, 400)  # left, top: the face


def measure(shared: Path, engine: str, threads: int, rounds: int) -> list[str]:
    """Return the lines of the table."""
    numba.set_num_threads(threads)
    image, defocus = photograph(shared)
    renderer = BokehRenderer(engine)
    bokeh = renderer.render_arrays(image, defocus).bokeh
    runs = {"plain render": lambda: renderer.render_arrays(image, defocus)}
    runs |= {name: lambda effects=effects: effects.apply(bokeh) for name, effects in TIMED.items()}
    for run in runs.values():
        run()
    rows = time_in_turns(runs, rounds)
    lines = []
    for name in runs:
        seconds = statistics.median(row[name] for row in rows)
        ratio = statistics.median(row[name] / row["plain render"] for row in rows)
        lines.append(f"{name:24s}{seconds:9.3f} s{100 * ratio:9.1f} % of the render")
    return lines


def round_trip(shared: Path) -> list[str]:
    """Return lines with the PSNR of the middle half after a distortion and its inverse, linear light."""
    image, defocus = photograph(shared)
    bokeh = BokehRenderer("rays").render_arrays(image, defocus).bokeh
    height, width = bokeh.shape[:2]
    middle = slice(height // 4, 3 * height // 4), slice(width // 4, 3 * width // 4)
    lines = []
    for name in ("distortion", "distortion, Brown", "lateral"):
        lens = TIMED[name]
        error = (lens.undo(lens.apply(bokeh)) - bokeh)[middle]
        lines.append(f"{name:24s} there and back{-10 * np.log10(np.mean(error**2)):7.1f} dB")
    return lines


def write_sheet(shared: Path, path: Path) -> None:
    """Write the blurred picture with each effect, reduced by a factor or as a crop at full resolution."""
    image, defocus = photograph(shared)
    bokeh = BokehRenderer("rays").render_arrays(image, defocus).bokeh
    pictures = [(name, effects.apply(bokeh)) for name, effects in SHOWN.items()]
    height, width = (size // REDUCTION for size in bokeh.shape[:2])
    small = []
    for name, picture in pictures:
        if name.endswith("a part"):
            shown = picture[CROP[1] :, CROP[0] :][:height, :width]
        else:
            cut = picture[: REDUCTION * height, : REDUCTION * width]
            shown = cut.reshape(height, REDUCTION, width, REDUCTION, 3).mean((1, 3))
        small.append((name, shown))
    rows = [small[start : start + 4] for start in range(0, len(small), 4)]
    write_image(path, np.clip(contact_sheet(rows), 0, 1), quality=85)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shared", type=Path, default=Path("../shared"), help="folder with real/21.jpg")
    parser.add_argument("--engine", default="rays", help="engine of the plain render")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--sheet", type=Path, help="write the pictures to this file instead of timing")
    arguments = parser.parse_args()
    if not (arguments.shared / "real/21.png").exists():
        print(f"skipped: found no real/21.png in {arguments.shared}")
    elif arguments.sheet is not None:
        write_sheet(arguments.shared, arguments.sheet)
    else:
        threads = min(2, numba.config.NUMBA_NUM_THREADS)
        print(f"picture 21 (1080x1350), {threads} threads, medians of {arguments.rounds} rounds in turns")
        lines = in_own_process(measure, arguments.shared, arguments.engine, threads, arguments.rounds)
        print("\n".join(lines + round_trip(arguments.shared)))


if __name__ == "__main__":
    main()

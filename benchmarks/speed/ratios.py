"""Cost of looks, lenses and noisy maps over that of a plain disc: ``python -m benchmarks.speed.ratios``.

Photograph 21 with its map, engine rays, processor seconds (user and system) of warm renders in turns.

looks: presets and traced lenses on the repaired map, without camera effects; the ratio is to a plain disc.
noise: the map with the noise of stereo matching, repair and render together; the ratio is that to the map
without noise, and the dB compare the picture with that of the map without noise.
SHARED holds ``real/21.jpg`` with its disparity ``21.png``.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.classical import BLUR, FOCUS
from benchmarks.figures import write_figures
from benchmarks.quality.scenes.repair_material import with_stereo_noise
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.image import write_map
from bokehnet.io.maps import read_disparity
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.scene import read_scene
from bokehnet.settings.preset import load_preset
from bokehnet.settings.settings import RenderSettings

_COMMAND = "python -m benchmarks.speed.ratios"

_PRESETS = (
    *("modern-50", "mirror-lens", "anamorphic", "portrait-85", "soap-bubble", "soft-focus"),
    *("rangefinder", "petzval-swirl", "double-gauss", "vintage-singlet"),
)

# Standard deviation of the noise, as a fraction of the range of the map.
_DEVIATIONS = (0.005, 0.01, 0.02, 0.04)

PLAIN, CLEAN = "plain disc", "no noise"


def _settings(disparity: Path) -> RenderSettings:
    changes = {
        "input": {"disparity": str(disparity)},
        "camera": {"blur": BLUR},
        "focus": {"value": FOCUS},
        "engine": {"name": "rays"},
    }
    return RenderSettings().updated(changes)


def _in_turns(runs: dict[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Return the processor seconds of each run in each round, after one run of each."""
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for turn in range(rounds + 1):
        for name, run in runs.items():
            start = time.process_time()
            run()
            if turn:
                seconds[name].append(time.process_time() - start)
    return seconds


def _rows(seconds: dict[str, list[float]], reference: str) -> dict[str, dict[str, float]]:
    """Return median seconds and the median of the ratios to ``reference``, and print them."""
    rows = {}
    for name, values in seconds.items():
        ratio = statistics.median(own / other for own, other in zip(values, seconds[reference], strict=True))
        rows[name] = {"seconds": statistics.median(values), "ratio": ratio}
        print(f"{name:20s} {rows[name]['seconds']:7.2f} s {ratio:6.2f}x", flush=True)
    return rows


def looks_section(shared: Path, rounds: int) -> dict[str, dict[str, float]]:
    """Return the rows of the looks."""
    base = _settings(shared / "real/21.png")
    renderer = BokehRenderer("rays")
    scene = renderer.prepare(read_scene(shared / "real/21.jpg", base), base)

    def rendering(settings: RenderSettings) -> Callable[[], object]:
        return lambda: renderer.render(scene, settings)

    runs = {PLAIN: rendering(base)}
    for name in _PRESETS:
        look = load_preset(name).over()
        runs[name] = rendering(replace(base, aperture=look.aperture, lens=look.lens, color=look.color))
    return _rows(_in_turns(runs, rounds), PLAIN)


def noise_section(shared: Path, rounds: int) -> dict[str, dict[str, float]]:
    """Return the rows of the noisy maps."""
    disparity = read_disparity(shared / "real/21.png")
    pictures: dict[str, np.ndarray] = {}
    with tempfile.TemporaryDirectory() as folder:

        def rendering(name: str, values: np.ndarray) -> Callable[[], object]:
            path = Path(folder) / f"{name.replace(' ', '_')}.exr"
            write_map(path, values)
            settings = _settings(path)
            scene = read_scene(shared / "real/21.jpg", settings)

            def run() -> None:  # a new renderer keeps no repaired map
                pictures[name] = linear_to_srgb(BokehRenderer("rays").render(scene, settings).bokeh)

            return run

        runs = {CLEAN: rendering(CLEAN, disparity)}
        for deviation in _DEVIATIONS:
            name = f"{100 * deviation:g} % of the range"
            runs[name] = rendering(name, with_stereo_noise(disparity, np.random.default_rng(0), deviation))
        rows = _rows(_in_turns(runs, rounds), CLEAN)
    for name, picture in pictures.items():
        if name != CLEAN:
            rows[name]["psnr"] = -10 * np.log10(np.mean((picture - pictures[CLEAN]) ** 2))
            print(f"{name:20s} {rows[name]['psnr']:.2f} dB to the picture of the map without noise")
    return rows


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    sections = {"looks": looks_section, "noise": noise_section}
    parser.add_argument("sections", nargs="*", metavar="SECTION", default=tuple(sections))
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--figures", type=Path, help="folder for ratios_looks.json and ratios_noise.json")
    arguments = parser.parse_args()
    columns = {
        "seconds": ("processor seconds", ".2f"),
        "ratio": ("ratio", ".2f"),
        "psnr": ("dB to the picture without noise", ".1f"),
    }
    for section in arguments.sections:
        if section not in sections:
            parser.error(f"unknown section {section}; expected {', '.join(sections)}")
        print(f"== {section}: processor seconds, medians of {arguments.rounds} rounds in turns")
        rows = sections[section](arguments.shared, arguments.rounds)
        if arguments.figures:
            conditions = f"photograph 21, blur {BLUR:g}, rays, medians of {arguments.rounds} rounds in turns"
            used = columns if section == "noise" else {key: columns[key] for key in ("seconds", "ratio")}
            path = arguments.figures / f"ratios_{section}.json"
            write_figures(path, f"{_COMMAND} {section}", conditions, used, rows)


if __name__ == "__main__":
    main()

"""Quality along the border of path-traced scenes: ``python -m benchmarks.experiments.edges.borders FOLDER``.

For each engine: PSNR in dB of the clipped sRGB picture in the band along the border, as the engine is, and of
the engine on pictures that are continued by repeated or mirrored pixels, or not at all (``inside``, by the
operator of the scatter alone, which divides by the light inside). Then two tests in closed form: light at the
border of a grey picture of 0.25 with a white line of one pixel around it, and the energy of a lamp on the
border, relative to its own.
"""

import argparse
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.quality.cycles import read_shots, scene_folders, whole_engine
from bokehnet.classical.scatter_renderer import scatter_inside
from bokehnet.engine_registry import ENGINES
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.optics.aperture import Aperture
from train.scores.evaluation_sets import Shot

BAND_PX = 32
_RADIUS = 15

Render = Callable[..., np.ndarray]


def _continued(render: Render, mode: str) -> Render:
    """Return a renderer of pictures that are continued by NumPy's padding ``mode``."""

    def padded(image: np.ndarray, defocus: np.ndarray, *, aperture: Aperture) -> np.ndarray:
        reach = math.ceil(float(np.abs(defocus).max())) + 1
        sides = ((reach, reach), (reach, reach))
        larger = np.pad(image, (*sides, (0, 0)), mode=mode)  # type: ignore[call-overload]
        radii = np.pad(defocus, sides, mode=mode)  # type: ignore[call-overload]
        return render(larger, radii, aperture=aperture)[reach:-reach, reach:-reach]

    return padded


def _band_psnr(render: Render, shot: Shot) -> float:
    band = np.ones(shot.defocus.shape, bool)
    band[BAND_PX:-BAND_PX, BAND_PX:-BAND_PX] = False
    pictures = (render(shot.image, shot.defocus, aperture=shot.aperture), shot.truth)
    result, truth = (linear_to_srgb(np.clip(picture[band], 0, 1)) for picture in pictures)
    return float(-10 * np.log10(np.mean((result - truth) ** 2)))


def _line_and_lamp(render: Render) -> tuple[float, float]:
    """Return the light at the border with a white line around it, and the relative energy of a lamp."""
    defocus = np.full((160, 240), -_RADIUS, np.float32)
    line = np.full((160, 240, 3), 0.25, np.float32)
    line[0] = line[-1] = line[:, 0] = line[:, -1] = 1
    lamp = np.full((160, 240, 3), 0.02, np.float32)
    lamp[0, 120] = 40
    lit = render(lamp, defocus, aperture=Aperture()) - np.float32(0.02)
    light = render(line, defocus, aperture=Aperture())[0, 120, 0]
    return float(light), float(lit.sum() / (lamp - np.float32(0.02)).sum())


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--engines", default=",".join(ENGINES), help="names, separated by commas")
    arguments = parser.parse_args()
    shots = [shot for folder in scene_folders(arguments.folder) for shot in read_shots(folder)]
    print(f"{'engine':10s}{'border':10s}{'dB':>8s}{'line':>8s}{'lamp':>8s}", flush=True)
    for name in arguments.engines.split(","):
        own = whole_engine(name)
        rules: dict[str, Render] = {
            "own": own,
            "repeated": _continued(own, "edge"),
            "mirrored": _continued(own, "symmetric"),
        }
        if name == "scatter":
            rules["inside"] = scatter_inside
        for rule, render in rules.items():
            psnr = np.mean([_band_psnr(render, shot) for shot in shots])
            light, energy = _line_and_lamp(render)
            print(f"{name:10s}{rule:10s}{psnr:8.2f}{light:8.3f}{energy:8.2f}", flush=True)


if __name__ == "__main__":
    main()

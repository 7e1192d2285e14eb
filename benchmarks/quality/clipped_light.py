"""Recovery of clipped light on traced scenes: ``python -m benchmarks.quality.clipped_light``.

Scenes of :mod:`train.data.light_scenes` are stored by cameras in 8 bits and rendered by the
rays, with and without recovery. The truth is traced through the lens and stored by the same camera. ``gap
closed`` is the gain in dB relative to that of a picture with its true light. Matter should gain and lose
nothing.
``--network FILE`` adds a column with the light of an exported LightNet; ``--ablate`` switches parts of the
recovery off; ``--figures FOLDER`` writes ``clipped_light.json`` there.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.figures import write_figures
from bokehnet.classical.rays_renderer import rays
from bokehnet.light.config import DEFAULT_CONFIG, LightConfig
from bokehnet.light.recovery import recover_light
from bokehnet.light.temporal import steady_light
from bokehnet.optics.coc import defocus_from_disparity
from train.data.light_regions import learned_sums, open_network
from train.data.light_scenes import (
    CAMERAS,
    LIGHT,
    MATTER,
    CameraCurve,
    LightCase,
    cases,
    decoded,
)
from train.scores.metrics import psnr

Recovery = Callable[[np.ndarray, np.ndarray], np.ndarray]

# Parts of the recovery, and constants without them.
_WITHOUT = {
    "all": {},
    "no halo: all lamps sharp": {"halo_growth": (9.0, 10.0)},
    "no edges: fixed gains": {"edge_blur": (-2.0, -1.0), "sharp_gain": 0.0},
    "light at even parts": {"edge_power": 0.0, "concentration": 0.0},
    "no colour of the sky": {"color_power": 0.0},
    "no fill: all clipped is light": {"fill": (-2.0, -1.0), "fill_far": (-2.0, -1.0)},
    "no night: all small is a lamp": {"night": (8.0, 9.0), "lamp_share": (-2.0, -1.0)},
}


def prototype(image: np.ndarray, gain: float = 8.0) -> np.ndarray:
    """Return a picture whose white, where the smallest channel is near its largest value, has a gain."""
    lowest = image.min(-1)
    top = float(np.quantile(lowest, 1 - 2e-5))
    clipped = (lowest >= 0.96 * top) & (top > 0.83)
    return np.where(clipped[..., None], np.float32(gain) * image, image)


def scores(case: LightCase, camera: CameraCurve, recoveries: Sequence[Recovery]) -> list[float]:
    """Return PSNR without recovery, with each recovery, and of the true light, dB."""
    defocus = defocus_from_disparity(case.disparity, case.blur, case.focus).astype(np.float32)
    original, truth = decoded(camera.store(case.image)), camera.store(case.truth) / 255
    plain = CameraCurve()
    rendered: dict[int, float] = {}

    def measured(image: np.ndarray, curve: CameraCurve) -> float:
        key = id(image)
        if key not in rendered:
            rendered[key] = psnr((curve.store(rays(image, defocus)) / 255 - truth) ** 2)
        return rendered[key]

    pictures = [original, *(recovery(original, case.disparity) for recovery in recoveries)]
    return [*(measured(picture, plain) for picture in pictures), measured(case.image, camera)]


def _recovery(config: LightConfig) -> Recovery:
    return lambda image, disparity: recover_light(image, disparity, 1.0, config).image


def _learned(path: Path) -> Recovery:
    network = open_network(path)

    def recover(image: np.ndarray, disparity: np.ndarray) -> np.ndarray:
        sums = learned_sums(image, disparity, network)
        return image if sums is None else steady_light(image, disparity, sums).image

    return recover


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4, help="scenes of each kind")
    parser.add_argument("--first", type=int, default=1, metavar="SEED", help="seed of the first scene")
    parser.add_argument("--cameras", nargs="+", default=["hard", "shoulder"], choices=[*CAMERAS])
    parser.add_argument("--kinds", nargs="+", default=[*LIGHT, *MATTER], choices=[*LIGHT, *MATTER])
    parser.add_argument("--ablate", action="store_true")
    parser.add_argument("--network", type=Path, metavar="FILE", help="ONNX file of a LightNet")
    parser.add_argument("--figures", type=Path, metavar="FOLDER")
    arguments = parser.parse_args()
    names = ["fixed gain 8", *(_WITHOUT if arguments.ablate else ["recovered"])]
    parts = _WITHOUT.values() if arguments.ablate else [{}]
    recoveries: list[Recovery] = [lambda image, _: prototype(image)]
    recoveries += [_recovery(replace(DEFAULT_CONFIG, **part)) for part in parts]
    if arguments.network is not None:
        names.append("network")
        recoveries.append(_learned(arguments.network))
    print(" | ".join(["kind | camera | off", *names, "true light | gap closed | worst"]))
    print(" | ".join(["---"] * (len(names) + 6)))
    figures = {}
    for kind in arguments.kinds:
        scenes = list(cases((kind,), range(arguments.first, arguments.first + arguments.seeds)))
        for camera_name in arguments.cameras:
            camera = CAMERAS[camera_name]
            rows = np.array([scores(case, camera, recoveries) for case in scenes])
            off, recovered, true = rows[:, 0], rows[:, 2], rows[:, -1]
            gap = float((true - off).mean())
            closed = f"{(recovered - off).mean() / gap:.2f}" if kind in LIGHT else ""
            means = " | ".join(f"{value:.2f}" for value in rows.mean(0))
            keys = ["off", *names, "true light"]
            figures[f"{kind}, {camera_name}"] = dict(zip(keys, rows.mean(0), strict=True))
            print(f"{kind} | {camera_name} | {means} | {closed} | {(recovered - off).min():+.2f}", flush=True)
    if arguments.figures is not None:
        ablated = " --ablate" if arguments.ablate else ""
        ablated += " --network FILE" if arguments.network is not None else ""
        kinds, cameras = " ".join(arguments.kinds), " ".join(arguments.cameras)
        ablated += f" --first {arguments.first}" if arguments.first != 1 else ""
        options = f"{ablated} --seeds {arguments.seeds} --cameras {cameras} --kinds {kinds}"
        write_figures(
            arguments.figures / "clipped_light.json",
            f"python -m benchmarks.quality.clipped_light{options} --figures docs/figures",
            f"own traced scenes of 384x256, {arguments.seeds} of each kind; mean PSNR of the rays, dB",
            {key: (key, ".2f") for key in next(iter(figures.values()))},
            figures,
        )


if __name__ == "__main__":
    main()

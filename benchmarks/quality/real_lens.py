"""Renders against photographs taken wide open: ``python -m benchmarks.quality.real_lens FOLDER``.

FOLDER holds one folder a case: ``input.png`` (stopped down), ``truth.png`` (wide open), ``disparity.png``
(16 bit, relative to 0..1), ``case.json`` with ``blur`` and ``focus``, and masks ``mask_NAME.png``. Prints
PSNR of the 8-bit picture, whole and inside each mask, for each engine with clipped light recovered and not.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_disparity
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import RelativeDisparity
from bokehnet.scene.scene import read_scene
from bokehnet.settings.settings import RenderSettings
from train.scores.metrics import psnr

_ENGINES = ("rays", "scatter", "hybrid", "fast")


def _masks(folder: Path, height: int, width: int) -> dict[str, np.ndarray]:
    """Return the masks of a case by name, (H, W) bool, first the whole picture."""
    paths = sorted(folder.glob("mask_*.png"))
    shown = {path.stem[5:]: read_image(path).max(-1) > srgb_to_linear(np.float32(0.5)) for path in paths}
    return {"whole": np.ones((height, width), bool), **shown}


def _rows(folder: Path, engines: list[str]) -> None:
    case = json.loads((folder / "case.json").read_text())
    truth = linear_to_srgb(read_image(folder / "truth.png"))
    masks = _masks(folder, *truth.shape[:2])
    disparity = read_disparity(folder / "disparity.png")
    for engine in engines:
        renderer = BokehRenderer(engine)
        for highlights in ("off", "auto"):
            settings = RenderSettings().updated(
                {
                    "camera": {"blur": case["blur"]},
                    "focus": {"value": case["focus"]},
                    "highlights": {"threshold": highlights},
                }
            )
            scene = read_scene(folder / "input.png", settings, source=RelativeDisparity(map=disparity))
            result = renderer.render(scene, settings)
            stored = np.round(255 * linear_to_srgb(np.clip(result.bokeh, 0, 1))) / 255
            values = [f"{name} {psnr((stored - truth)[mask] ** 2):.2f}" for name, mask in masks.items()]
            if "lights" in masks:
                ours, true = (srgb_to_linear(x[masks["lights"]]).mean(0) for x in (stored, truth))
                values.append(f"B/R {ours[2] / ours[0]:.2f} (true {true[2] / true[0]:.2f})")
            print(" | ".join([folder.name, engine, highlights, ", ".join(values)]), flush=True)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--engines", nargs="+", default=["rays", "scatter"], choices=_ENGINES)
    arguments = parser.parse_args()
    print("case | engine | highlights | PSNR, dB")
    print("--- | --- | --- | ---")
    for folder in sorted(path.parent for path in arguments.folder.glob("*/case.json")):
        _rows(folder, arguments.engines)


if __name__ == "__main__":
    main()

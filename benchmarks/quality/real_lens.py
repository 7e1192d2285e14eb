"""Renders against photographs taken wide open: ``python -m benchmarks.quality.real_lens FOLDER``.

FOLDER holds one folder a case: ``input.png`` (stopped down), ``truth.png`` (wide open), ``disparity.png``
(16 bit, relative to 0..1), ``case.json`` with ``blur`` and ``focus``, and masks ``mask_NAME.png``. Prints
PSNR of the 8-bit picture, whole and inside each mask, for each engine with clipped light recovered and not.
``--network FILE`` adds the light of an exported LightNet; ``--json FILE`` writes the table.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.io.files.atomic import write_text
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_disparity
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import RelativeDisparity
from bokehnet.scene.scene import read_scene
from bokehnet.settings.settings import RenderSettings
from train.data.light_regions import Network, learned_sums, open_network
from train.scores.metrics import psnr

_ENGINES = ("rays", "scatter", "hybrid", "fast")


def _masks(folder: Path, height: int, width: int) -> dict[str, np.ndarray]:
    """Return the masks of a case by name, (H, W) bool, first the whole picture."""
    paths = sorted(folder.glob("mask_*.png"))
    shown = {path.stem[5:]: read_image(path).max(-1) > srgb_to_linear(np.float32(0.5)) for path in paths}
    return {"whole": np.ones((height, width), bool), **shown}


def _rows(folder: Path, engines: list[str], network: Network | None) -> Iterator[dict[str, str | float]]:
    """Yield a row of values by column for each engine and light; PSNR in dB."""
    case = json.loads((folder / "case.json").read_text())
    truth = linear_to_srgb(read_image(folder / "truth.png"))
    masks = _masks(folder, *truth.shape[:2])
    disparity = read_disparity(folder / "disparity.png")
    for engine in engines:
        renderer = BokehRenderer(engine)
        for highlights in ("off", "auto") if network is None else ("off", "auto", "network"):
            settings = RenderSettings().updated(
                {
                    "camera": {"blur": case["blur"]},
                    "focus": {"value": case["focus"]},
                    "highlights": {"threshold": "off" if highlights == "off" else "auto"},
                }
            )
            scene = read_scene(folder / "input.png", settings, source=RelativeDisparity(map=disparity))
            if network is not None and highlights == "network":
                scene = replace(scene, light_sums=learned_sums(scene.image, disparity, network))
            result = renderer.render(scene, settings)
            stored = np.round(255 * linear_to_srgb(np.clip(result.bokeh, 0, 1))) / 255
            row: dict[str, str | float] = {"case": folder.name, "engine": engine, "highlights": highlights}
            row |= {name: round(psnr((stored - truth)[mask] ** 2), 2) for name, mask in masks.items()}
            if "lights" in masks:
                own, true = (srgb_to_linear(x[masks["lights"]]).mean(0) for x in (stored, truth))
                row |= {
                    "B/R": round(float(own[2] / own[0]), 3),
                    "true B/R": round(float(true[2] / true[0]), 3),
                }
            yield row


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--engines", nargs="+", default=["rays", "scatter"], choices=_ENGINES)
    parser.add_argument("--network", type=Path, metavar="FILE", help="ONNX file of a LightNet")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table as JSON")
    arguments = parser.parse_args()
    network = None if arguments.network is None else open_network(arguments.network)
    print("case | engine | highlights | PSNR, dB")
    print("--- | --- | --- | ---")
    rows = []
    for folder in sorted(path.parent for path in arguments.folder.glob("*/case.json")):
        for row in _rows(folder, arguments.engines, network):
            rows.append(row)
            case, engine, light, *values = row.items()
            shown = ", ".join(f"{name} {value:.2f}" for name, value in values)
            print(" | ".join([str(case[1]), str(engine[1]), str(light[1]), shown]), flush=True)
    if arguments.json is not None:
        write_text(arguments.json, json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()

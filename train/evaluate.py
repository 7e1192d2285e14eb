"""Score the engines on held-out, ray-traced pairs, through the shipped renderer.

``python -m train.evaluate --data data/planes_val``
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from tqdm import tqdm

from bokehnet.errors import BokehnetError
from bokehnet.inference.pipeline import ENGINES, BokehRenderer
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.synth.shards import ShardSet
from train.metrics import compare, mean_scores

__all__ = ["evaluate", "main"]


def evaluate(renderer: BokehRenderer, samples: ShardSet) -> dict[str, float]:
    """Mean scores of one engine over all views of all samples, given their true disparity."""
    rows = []
    for index in tqdm(range(len(samples)), desc=renderer.engine, mininterval=1):
        sample = samples[index]
        for view in range(len(sample.blur)):
            blur, focus = float(sample.blur[view]), float(sample.focus[view])
            defocus = defocus_from_disparity(sample.disparity, blur, focus)
            render = renderer.render(sample.image.astype(np.float32), defocus).bokeh
            rows.append(compare(render, sample.bokeh[view].astype(np.float32), defocus))
    return mean_scores(rows)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", required=True, type=Path, help="folder of shards")
    parser.add_argument("--engine", action="append", choices=ENGINES, help="engine to score; default: all")
    parser.add_argument("--weights", type=Path, help="folder of the networks; default: the package's own")
    arguments = parser.parse_args()
    try:
        samples = ShardSet(arguments.data)
        table = {
            engine: evaluate(BokehRenderer(engine, weights=arguments.weights), samples)
            for engine in arguments.engine or ENGINES
        }
    except BokehnetError as error:
        sys.exit(f"error: {error}")
    columns = ("psnr", "ssim", "edge_psnr", "edge_ssim")
    print(f"{'engine':10s}" + "".join(f"{column:>11s}" for column in columns))
    for engine, scores in table.items():
        print(f"{engine:10s}" + "".join(f"{scores[column]:11.4f}" for column in columns))


if __name__ == "__main__":
    main()

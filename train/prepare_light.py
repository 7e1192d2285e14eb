"""Make regions for LightNet.

``python -m train.prepare_light --config configs/prepare_light.toml --out data/light``

Traces scenes, stores each by random cameras and writes one file a scene; an interrupted run resumes.
"""

import argparse
import sys
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path

import torch
from tqdm import tqdm

from bokehnet.config import load_config
from bokehnet.errors import BokehnetError
from train.data.light_data import LightScenesConfig, make_scene
from train.run.command import add_settings, settings_of

__all__ = ["main"]


def _make(job: tuple[int, LightScenesConfig, Path]) -> None:
    torch.set_num_threads(1)
    number, config, path = job
    if not path.exists():
        make_scene(number, config, path)


def main(words: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--config", required=True, type=Path, help="TOML file of the set")
    parser.add_argument(
        "--out", required=True, type=Path, help="folder of the set; resumes one that it holds"
    )
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    add_settings(parser)
    arguments = parser.parse_args(words)
    try:
        config = load_config(arguments.config, LightScenesConfig, settings_of(arguments))
        arguments.out.mkdir(parents=True, exist_ok=True)
        jobs = [
            (number, config, arguments.out / f"scene-{number:05d}.npz") for number in range(config.scenes)
        ]
        with get_context("spawn").Pool(arguments.workers) as pool:
            for _ in tqdm(pool.imap_unordered(_make, jobs), total=len(jobs), disable=None):
                pass
    except (BokehnetError, OSError) as error:
        sys.exit(f"error: {' '.join(str(error).split())}")
    print(f"done: {arguments.out}")


if __name__ == "__main__":
    main()

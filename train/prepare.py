"""Render the classical half of all training pairs once, before training.

``python -m train.prepare --config configs/prepare_rays.toml --out data/rays``

Each view of each scene gives one example with its true disparity, and ``augmented`` more with augmented
disparity. A fraction of the augmented maps is repaired first, as in use. A killed run resumes and
writes the same bytes.
"""

import argparse
import functools
import json
import multiprocessing
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from bokehnet.classical.base import make_classical
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.config import check_same, load_config, renamed, to_dict
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.errors import BokehnetError, ConfigError, DataFileError
from bokehnet.io.files.atomic import remove_leftovers, write_atomic, write_text
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.synth.dataset import start_worker
from bokehnet.synth.shards import ShardSet, TrainingSample
from train.data.augmentation import augment_disparity
from train.data.examples import Skips
from train.data.prepared import DESCRIPTION, NUM_PLANES, PLANES, part_name
from train.run.command import add_settings, settings_of

__all__ = ["PrepareConfig", "main", "prepare", "prepare_view"]


@dataclass(frozen=True, kw_only=True)
class PrepareConfig:
    """Configuration of a prepared set.

    Attributes:
        folder: Shards of ``bokehnet synth``.
        classical: Classical renderer whose result the networks will correct.
        augmented: Number of examples with augmented disparity per view, in addition to the true one.
        repaired: Fraction of the augmented maps that are repaired, 0 to 1.
        seed: Seed of the augmentation.
        scenes_per_part: Number of scenes per file.
    """

    folder: str
    classical: str = "rays"
    augmented: int = 1
    repaired: float = 0.0
    seed: int = 0
    scenes_per_part: int = 25


def prepare_view(sample: TrainingSample, view: int, disparity: np.ndarray, classical: str) -> np.ndarray:
    """Render one view with ``disparity`` (H, W); return the planes (NUM_PLANES, H, W) float16."""
    image = sample.image.astype(np.float32)
    blur, focus = float(sample.blur[view]), float(sample.focus[view])
    defocus = defocus_from_disparity(disparity, blur, focus)
    result = make_classical(classical)(image, defocus)
    target = result.error_map
    if disparity is not sample.disparity:
        true = geometric_error_map(defocus_from_disparity(sample.disparity, blur, focus))
        target = np.maximum(target, true)
    parts = {
        "image": image,
        "classical": result.bokeh,
        "truth": sample.bokeh[view],
        "occluded_background": image if result.occluded_background is None else result.occluded_background,
        "defocus": defocus[..., None],
        "disocclusion_weight": np.zeros_like(target)[..., None]
        if result.disocclusion_weight is None
        else result.disocclusion_weight[..., None],
        "classical_error_map": result.error_map[..., None],
        "target": target[..., None],
    }
    planes = np.empty((NUM_PLANES, *disparity.shape), np.float16)
    for name, place in PLANES.items():
        planes[place] = parts[name].transpose(2, 0, 1)
    return planes


def _prepare_scene(config: PrepareConfig, samples: ShardSet, number: int) -> list[np.ndarray] | DataFileError:
    """Return all examples of a scene, or the error if it is damaged."""
    try:
        sample = samples[number]
    except DataFileError as error:
        return error
    rng = np.random.default_rng([config.seed, number])
    examples = []
    for view in range(len(sample.blur)):
        examples.append(prepare_view(sample, view, sample.disparity, config.classical))
        for _ in range(config.augmented):
            augmented = augment_disparity(sample.disparity, rng)
            if rng.random() < config.repaired:
                augmented = DisparityRepair()(sample.image.astype(np.float32), augmented)
            examples.append(prepare_view(sample, view, augmented, config.classical))
    return examples


def _start_worker() -> None:
    import numba

    start_worker()
    numba.set_num_threads(1)


def prepare(config: PrepareConfig, out: Path, workers: int = 1) -> None:
    """Write all missing parts. Reports, counts and skips damaged scenes.

    Args:
        config: Configuration of the set; also written as ``prepared.json``.
        out: Folder of the set; created if missing.
        workers: Number of processes that render.

    Raises:
        ConfigError: The folder holds a set made with another configuration.
        DataFileError: The pairs cannot be read or the folder cannot be written.
    """
    skips = Skips()
    samples = ShardSet(Path(config.folder), on_damage=skips)
    numbers = range(len(samples))
    parts = [
        numbers[first : first + config.scenes_per_part]
        for first in range(0, len(samples), config.scenes_per_part)
    ]
    out.mkdir(parents=True, exist_ok=True)
    _claim(out, config, len(parts))
    remove_leftovers(out)
    missing = [i for i in range(len(parts)) if not (out / part_name(i)).exists()]
    pending = [number for i in missing for number in parts[i]]
    work = functools.partial(_prepare_scene, config, samples)
    with (
        ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _start_worker) as executor,
        tqdm(total=len(samples), initial=len(samples) - len(pending), desc="preparing scenes") as bar,
    ):
        scenes = executor.map(work, pending, chunksize=2)
        for i in missing:
            examples: list[np.ndarray] = []
            for _ in parts[i]:
                if isinstance(scene := next(scenes), DataFileError):
                    skips(scene)
                else:
                    examples += scene
                bar.update()
            array = np.stack(examples) if examples else np.empty((0, NUM_PLANES, 1, 1), np.float16)

            def write(temporary: Path, array: np.ndarray = array) -> None:
                with temporary.open("wb") as stream:
                    np.save(stream, array)

            write_atomic(out / part_name(i), write, error=DataFileError)


def _claim(out: Path, config: PrepareConfig, parts: int) -> None:
    """Write the description, or compare an existing one with ``config``."""
    path = out / DESCRIPTION
    expected = {"parts": parts, "config": to_dict(config)}
    if not path.exists():
        write_text(path, json.dumps(expected, indent=2) + "\n", error=DataFileError)
        return
    try:
        existing = json.loads(path.read_text(encoding="utf-8"))
        existing = {**existing, "config": renamed(existing["config"])}
    except ValueError as error:
        raise ConfigError(f"{path}: expected a description as JSON: {error}") from error
    check_same(f"{out}: holds examples", existing, expected, "choose another folder")


def main(words: Sequence[str] | None = None) -> None:
    """Entry of the command line; a user error prints one line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--config", required=True, type=Path, help="TOML file of the set")
    parser.add_argument(
        "--out", required=True, type=Path, help="folder of the set; resumes a run that it already holds"
    )
    add_settings(parser)
    parser.add_argument("--workers", type=int, default=1, help="number of processes that render")
    arguments = parser.parse_args(words)
    try:
        config = load_config(arguments.config, PrepareConfig, settings_of(arguments))
        prepare(config, arguments.out, arguments.workers)
        print(f"wrote {arguments.out}: the pairs of {config.folder} with engine {config.classical}")
    except BokehnetError as error:
        sys.exit(f"error: {' '.join(str(error).split())}")


if __name__ == "__main__":
    main()

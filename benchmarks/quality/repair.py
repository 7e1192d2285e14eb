"""Gain and harm of the depth repair: ``python -m benchmarks.quality.repair --harm``, or another mode.

``--harm`` compares the repaired map with the map left alone, for maps of estimators that are not wrong at
edges in the way of networks: exact maps at 384 and 2560 pixels, 8-bit, plane-sweep, stereo, lidar and
time-of-flight maps, maps with missing bands and outliers, random maps, and sides of the same texture.
``--ablate`` switches off every stage in turn. Figures are edge PSNR of the ray engine against path-traced
pictures, dB; at 2560 pixels the fraction of changed pixels near edges. ``--data FOLDER`` evaluates faults on
other path-traced scenes, in the layout of :func:`train.scores.evaluation_sets.path_traced_shots`.
``--sequence`` compares the gain on each faulty map as a still and as a frame of a pan, whose plan is the
common one of crops, and prints the fraction of pixels in which both maps differ. ``--file`` compares the ONNX
file of ``bokehnet export --repair`` with the package.
"""

import argparse
import hashlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.figures import write_figures
from benchmarks.quality.scenes.repair_faults import FAULTS
from benchmarks.quality.scenes.repair_material import (
    ESTIMATORS,
    Scene,
    layered_scene,
    read_scenes,
)
from bokehnet.classical.rays_renderer import rays
from bokehnet.depth_repair.config import STAGES, RepairConfig
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.repair_plan import common_plan
from bokehnet.onnx_session import OnnxSession
from bokehnet.optics.aperture import Aperture
from train.scores.evaluation_sets import path_traced_shots, scene_folders
from train.scores.metrics import compare

# Default folder of the traced scenes, and number of scenes.
_CACHE, _SCENES = Path("runs/repair_scenes"), 6

# Left columns of the crops of a pan, pixels.
_PAN_PX = (0, 6, 12)

# Minimum change of a pixel that counts, as a fraction of the range of the map.
_MIN_CHANGE = 0.025


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Case:
    """Map to repair and its evaluation.

    Attributes:
        kind: Estimator or fault.
        name: Scene.
        image: All-in-focus picture, scene-linear, (H, W, 3).
        disparity: Map, (H, W).
        score: Function that returns the edge PSNR of a render with a map, dB.
    """

    kind: str
    name: str
    image: np.ndarray
    disparity: np.ndarray
    score: Callable[[np.ndarray], float]


def scene_case(kind: str, scene: Scene, disparity: np.ndarray) -> Case:
    """Return the case of a map of a traced scene."""

    def score(values: np.ndarray) -> float:
        defocus, true = (
            np.float32(scene.blur) * (d - np.float32(scene.focus)) for d in (values, scene.disparity)
        )
        return float(compare(rays(scene.image, defocus), scene.truth, true)["edge_psnr"])

    return Case(kind=kind, name=scene.name, image=scene.image, disparity=disparity, score=score)


def harm_cases(scenes: list[Scene]) -> Iterator[Case]:
    """Yield the maps of all estimators for all scenes, and exact maps of sides with the same texture."""
    for number, scene in enumerate(scenes):
        for kind, estimate in ESTIMATORS.items():
            yield scene_case(kind, scene, estimate(scene, np.random.default_rng(number)))
    for kind in ("discs", "fence"):
        scene = layered_scene(kind)
        yield scene_case(scene.name, scene, scene.disparity)


def fault_cases(scenes: list[Scene]) -> Iterator[Case]:
    """Yield the true maps of all scenes and of a railing with every fault."""
    for number, scene in enumerate([*scenes, layered_scene("railing")]):
        for kind, spoil in FAULTS.items():
            values = spoil(scene.disparity, np.random.default_rng(number))
            yield scene_case(kind, scene, np.asarray(values, np.float32))


def data_cases(folder: Path, shots: int) -> Iterator[Case]:
    """Yield the true maps of other path-traced scenes with every fault, scored by some shots."""
    for number, path in enumerate(scene_folders(folder)):
        pictures = list(path_traced_shots(path))[:shots]
        true = pictures[0].disparity
        assert true is not None
        low, high = float(true.min()), float(true.max())

        def score(
            values: np.ndarray, pictures: list = pictures, low: float = low, high: float = high
        ) -> float:
            scores = []
            for shot in pictures:
                # Defocus is linear in disparity.
                slope, constant = np.polyfit(shot.disparity.ravel()[::97], shot.defocus.ravel()[::97], 1)
                defocus = (slope * (low + (high - low) * values) + constant).astype(np.float32)
                render = rays(shot.image, defocus, aperture=shot.aperture or Aperture())
                scores.append(compare(render, shot.truth, shot.defocus)["edge_psnr"])
            return float(np.mean(scores))

        relative = ((true - low) / (high - low)).astype(np.float32)
        for kind, spoil in {"true": lambda d, _: d, **FAULTS}.items():
            values = np.asarray(spoil(relative, np.random.default_rng(number)), np.float32)
            yield Case(kind=kind, name=path.name, image=pictures[0].image, disparity=values, score=score)


def with_score_cache(case: Case) -> Case:
    """Return a case that renders equal maps once."""
    scores: dict[bytes, float] = {}

    def score(values: np.ndarray) -> float:
        key = hashlib.sha256(np.ascontiguousarray(values)).digest()
        if key not in scores:
            scores[key] = case.score(values)
        return scores[key]

    return replace(case, score=score)


class FileRepair:
    """Depth repair of the ONNX file in place of that of the package."""

    def __init__(self) -> None:
        from bokehnet.onnx_file.depth_repair import build_repair

        self._session = OnnxSession(build_repair().SerializeToString(), options={"log_severity_level": 3})

    def __call__(self, image: np.ndarray, disparity: np.ndarray, _: str = "auto") -> np.ndarray:
        """Return the repaired map."""
        return self._session.run({"image": image, "disparity": disparity})[0]


def evaluate(cases: list[Case], repair: Callable[..., np.ndarray]) -> list[dict[str, float]]:
    """Return gain (dB) and milliseconds of the processor of each case."""
    rows = []
    for case in cases:
        start = time.process_time()
        result = repair(case.image, case.disparity, "auto")
        seconds = time.process_time() - start
        alone, after = case.score(case.disparity), case.score(result)
        rows.append({"alone": alone, "repaired": after, "gain": after - alone, "ms": 1000 * seconds})
    return rows


def by_kind(cases: list[Case], rows: list[dict[str, float]]) -> dict[str, dict[str, float]]:
    """Return means and the lowest gain of each kind, and of all."""
    table = {}
    for kind in [*dict.fromkeys(case.kind for case in cases), "all"]:
        chosen = [row for case, row in zip(cases, rows, strict=True) if kind in (case.kind, "all")]
        means = {key: float(np.mean([row[key] for row in chosen])) for key in chosen[0]}
        table[kind] = {**means, "lowest": min(row["gain"] for row in chosen)}
    return table


def print_table(table: dict[str, dict[str, float]]) -> None:
    """Print one row per kind."""
    keys = list(next(iter(table.values())))
    print(f"{'':24s}" + "".join(f" {key:>13s}" for key in keys))
    for kind, row in table.items():
        print(f"{kind:24s}" + "".join(f" {row[key]:13.2f}" for key in keys), flush=True)


def large_rows(folder: Path, count: int, repair: DisparityRepair) -> dict[str, dict[str, float]]:
    """Return the fraction of pixels (%) that the repair changes in exact maps at 2560 pixels, and seconds."""
    rows = {}
    for scene in read_scenes(folder, count, large=True):
        start = time.process_time()
        result = repair.repair(scene.image, scene.disparity, "auto")
        change = float((np.abs(result.disparity - scene.disparity) > _MIN_CHANGE).mean())
        rows[scene.name] = {"changed %": 100 * change, "ms": 1000 * (time.process_time() - start)}
    return rows


def sequence_rows(cases: list[Case], repair: DisparityRepair) -> list[dict[str, float]]:
    """Return the gain of each map as a still and as a frame of a pan, dB, and the difference of both."""
    rows = []
    for case in cases:
        width = case.disparity.shape[1] - max(_PAN_PX)
        crops = [np.s_[:, left : left + width] for left in _PAN_PX]
        plans = [repair.repair(case.image[crop], case.disparity[crop], "auto").plan for crop in crops]
        plan = common_plan([plan for plan in plans if plan is not None])
        still = repair.repair(case.image, case.disparity, "auto").disparity
        frame = repair.repair(case.image, case.disparity, "auto", plan=plan).disparity
        alone = case.score(case.disparity)
        differences = float((np.abs(still - frame) > _MIN_CHANGE).mean())
        rows.append(
            {
                "gain": case.score(still) - alone,
                "gain in a pan": case.score(frame) - alone,
                "different %": 100 * differences,
            }
        )
    return rows


def compare_file(scenes: list[Scene]) -> dict[str, dict[str, float]]:
    """Return by kind of map the edge PSNR of the map left alone, and repaired by the file and the package."""
    cases = [with_score_cache(case) for case in (*fault_cases(scenes), *harm_cases(scenes))]
    by_file, by_package = (
        by_kind(cases, evaluate(cases, repair)) for repair in (FileRepair(), DisparityRepair())
    )
    return {
        kind: {
            "alone": row["alone"],
            "file": row["repaired"],
            "package": by_package[kind]["repaired"],
            "lowest of the file": row["lowest"],
        }
        for kind, row in by_file.items()
    }


def ablate(scenes: list[Scene]) -> dict[str, dict[str, float]]:
    """Return gain on faults, gain and lowest gain on the harm set, and milliseconds without each stage."""
    faults, harm = (list(map(with_score_cache, cases(scenes))) for cases in (fault_cases, harm_cases))
    table = {}
    for missing in (None, *STAGES):
        repair = DisparityRepair(config=RepairConfig(stages=frozenset(STAGES) - {missing}))
        gains, harms = by_kind(faults, evaluate(faults, repair)), by_kind(harm, evaluate(harm, repair))
        name = "all stages" if missing is None else f"without {missing}"
        table[name] = {
            **{kind: row["gain"] for kind, row in gains.items()},
            "harm set": harms["all"]["gain"],
            "lowest": harms["all"]["lowest"],
            "ms": gains["all"]["ms"],
        }
        print_table({name: table[name]})
    return table


def main() -> None:
    """Print tables, and write them to files of figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--harm", action="store_true", help="gain on maps that are not wrong in the usual ways"
    )
    parser.add_argument("--ablate", action="store_true", help="gain and harm without each stage")
    parser.add_argument("--sequence", action="store_true", help="gain on stills and on frames of a pan")
    parser.add_argument("--file", action="store_true", help="gain of the ONNX file and of the package")
    parser.add_argument("--data", type=Path, help="folder of other path-traced scenes")
    parser.add_argument("--shots", type=int, default=2, help="shots per scene of --data, from the first")
    parser.add_argument("--scenes", type=int, default=_SCENES, help="number of traced scenes")
    parser.add_argument("--large", type=int, default=2, help="number of scenes at 2560 pixels with --harm")
    parser.add_argument("--cache", type=Path, default=_CACHE, help="folder of the traced scenes")
    parser.add_argument("--figures", type=Path, help="folder for JSON files, such as docs/figures")
    arguments = parser.parse_args()
    if arguments.data:
        cases = list(map(with_score_cache, data_cases(arguments.data, arguments.shots)))
        print_table(by_kind(cases, evaluate(cases, DisparityRepair())))
        return
    scenes = read_scenes(arguments.cache, arguments.scenes)
    tables = {}
    if arguments.harm:
        cases = list(map(with_score_cache, harm_cases(scenes)))
        tables["harm"] = by_kind(cases, evaluate(cases, DisparityRepair()))
        print_table(tables["harm"])
        if arguments.large:
            print_table(large_rows(arguments.cache, arguments.large, DisparityRepair()))
    if arguments.sequence:
        cases = list(map(with_score_cache, fault_cases(scenes)))
        tables["sequence"] = by_kind(cases, sequence_rows(cases, DisparityRepair()))
        print_table(tables["sequence"])
    if arguments.ablate:
        tables["ablate"] = ablate(scenes)
    if arguments.file:
        tables["file"] = compare_file(scenes)
        print_table(tables["file"])
    if arguments.figures:
        count = "" if len(scenes) == _SCENES else f" --scenes {len(scenes)}"
        for name, table in tables.items():
            columns = {key: (key, ".0f" if key == "ms" else ".2f") for key in next(iter(table.values()))}
            write_figures(
                arguments.figures / f"repair_{name}.json",
                f"python -m benchmarks.quality.repair --{name}{count} --figures docs/figures",
                f"{len(scenes)} path-traced scenes of 384x256; edge PSNR of the ray engine, dB",
                columns,
                table,
            )


if __name__ == "__main__":
    main()

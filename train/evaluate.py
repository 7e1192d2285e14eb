"""Score methods on pictures with ground truth, with true and degraded disparity.

``python -m train.evaluate --data cycles FOLDER --method rays --method hybrid:runs/best+repair``

A method is ``ENGINE[:FOLDER][+repair]``: the engine, the folder of its networks, by default those of the
    package, and an optional repair of the disparity. Edges and blur radii
    that classify pixels are always the true ones, whatever disparity a method receives.
"""

import argparse
import json
import multiprocessing
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numba
import torch
from tqdm import tqdm

from bokehnet.checks import check_choice, check_number, require_extra
from bokehnet.engine_registry import ENGINES
from bokehnet.errors import BokehnetError, ParameterError
from train.data.degradation import DEGRADATIONS, EDGE_SHIFT, degrade
from train.scores.evaluation_sets import SETS, Picture, list_pictures
from train.scores.methods import REPAIRS, Method, parse_method
from train.scores.metrics import Scorer
from train.scores.report import TABLES, Row, as_json, differences, excess, format_table, mean_rows

__all__ = ["evaluate", "main", "score_picture"]


def score_picture(
    picture: Picture, methods: Sequence[Method], degradations: Sequence[str], edge_shift: int = EDGE_SHIFT
) -> list[Row]:
    """Return the scores of every method on one picture with every kind of disparity."""
    shot = picture.read()
    scorer = Scorer(shot.truth, shot.defocus, shot.disparity)
    rows = []
    for kind in degradations:
        degraded = degrade(shot.defocus, kind, edge_shift)
        repaired = {None: degraded}
        for method in methods:
            if method.repair not in repaired:
                repaired[method.repair] = REPAIRS[method.repair](shot.image, degraded)
            result = method.render(shot.image, repaired[method.repair], shot.aperture)
            classical = None if result.neural is None else result.classical
            rows.append(Row(method=method.name, disparity=kind, scores=scorer(result.bokeh, classical)))
    return rows


def evaluate(
    pictures: Sequence[Picture],
    methods: Sequence[Method],
    degradations: Sequence[str] = DEGRADATIONS,
    *,
    edge_shift: int = EDGE_SHIFT,
    jobs: int = 1,
    progress: Callable[[int], object] = lambda done: None,
) -> list[list[Row]]:
    """Return the scores of every method on every picture with every kind of disparity.

    Args:
        pictures: Pictures to render.
        methods: Methods to score.
        degradations: Names from ``train.data.degradation.DEGRADATIONS``.
        edge_shift: Displacement of edges in eroded and dilated disparity, pixels.
        jobs: Number of processes that share pictures and cores.
        progress: Called after each picture with the number of pictures done.

    Returns:
        For each picture, one row per method and disparity.
    """
    work = partial(score_picture, methods=methods, degradations=degradations, edge_shift=edge_shift)
    rows = []
    if jobs == 1:
        _share_cores(1)
        for done, picture in enumerate(pictures, 1):
            rows.append(work(picture))
            progress(done)
        return rows
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, spawn, _share_cores, (jobs,)) as pool:
        for done, scores in enumerate(pool.map(work, pictures), 1):
            rows.append(scores)
            progress(done)
    return rows


def _share_cores(jobs: int) -> None:
    """Give this process its share of the cores; torch gets one, as small pictures do not scale to more."""
    numba.set_num_threads(max(1, numba.config.NUMBA_NUM_THREADS // jobs))
    torch.set_num_threads(1)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add(
        "--data",
        required=True,
        nargs=2,
        metavar=("KIND", "FOLDER"),
        help=f"evaluation set; KIND: {', '.join(SETS)}",
    )
    add("--method", action="append", metavar="METHOD", help=f"default: {', '.join(ENGINES)}")
    add("--disparity", action="append", metavar="KIND", help=f"default: {', '.join(DEGRADATIONS)}")
    add(
        "--edge-shift",
        type=int,
        default=EDGE_SHIFT,
        help="edge displacement of eroded and dilated disparity, pixels; default %(default)s",
    )
    add("--limit", type=int, help="maximum number of scenes")
    add("--baseline", metavar="METHOD", help="also print the differences to this method")
    add(
        "--noise-floor",
        type=float,
        nargs=2,
        metavar=("ALL", "EDGE"),
        help="PSNR of the truth's noise over all and over edge pixels, dB; subtracted from the mean errors",
    )
    add("--markdown", action="store_true", help="print Markdown tables")
    add("--json", type=Path, help="write all scores to this file")
    add("--jobs", type=int, default=1, help="number of processes; default %(default)s")
    return parser.parse_args(arguments)


def _check(options: argparse.Namespace, names: Sequence[str]) -> None:
    """Raise ParameterError for a bad option before any work."""
    for name in ("limit", "jobs"):
        value = getattr(options, name)
        if value is not None and value < 1:
            raise ParameterError(f"--{name}", "at least 1", value)
    if options.edge_shift < 0:
        raise ParameterError("--edge-shift", "at least 0", options.edge_shift)
    for kind in options.disparity or ():
        check_choice("--disparity", kind, DEGRADATIONS)
    if options.baseline is not None:
        check_choice("--baseline", options.baseline, names)
    for floor in options.noise_floor or ():
        check_number("--noise-floor", floor)
    if options.json is not None and not options.json.parent.is_dir():
        remedy = f"there is no folder {options.json.parent}, make it"
        raise ParameterError("--json", "a file in a folder that exists", str(options.json), remedy)
    for module in ("flip_evaluator", "pytorch_msssim"):
        require_extra(module, "train")


def _run(options: argparse.Namespace) -> None:
    methods = [parse_method(text) for text in dict.fromkeys(options.method or ENGINES)]
    _check(options, [method.name for method in methods])
    kind, folder = options.data
    pictures = list_pictures(kind, Path(folder), options.limit)
    for method in methods:
        method.load()
    with tqdm(total=len(pictures), desc="pictures") as bar:
        rows = evaluate(
            pictures,
            methods,
            list(dict.fromkeys(options.disparity or DEGRADATIONS)),
            edge_shift=options.edge_shift,
            jobs=options.jobs,
            progress=lambda done: bar.update(),
        )
    means = mean_rows([row for picture_rows in rows for row in picture_rows])
    if options.noise_floor:
        means = excess(means, dict(zip(("psnr", "edge_psnr"), options.noise_floor, strict=True)))
    print(f"{kind} {folder}: means over {len(pictures)} pictures, dB and [0, 1]")
    _print_tables(means, options.markdown, "")
    if options.baseline is not None:
        _print_tables(differences(means, options.baseline), options.markdown, f", less {options.baseline}")
    if options.json is not None:
        scores = [
            {"scene": picture.scene, "picture": picture.name, "rows": as_json(picture_rows)}
            for picture, picture_rows in zip(pictures, rows, strict=True)
        ]
        text = json.dumps({"means": as_json(means), "pictures": scores}, indent=1, allow_nan=False)
        options.json.write_text(text + "\n", encoding="utf-8")


def _print_tables(rows: Sequence[Row], markdown: bool, ending: str) -> None:
    for title, columns in TABLES.items():
        table = format_table(title + ending, columns, rows, markdown=markdown, signed=bool(ending))
        if table:
            print(f"\n{table}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    options = _parse(arguments)
    try:
        _run(options)
    except BokehnetError as error:
        sys.exit(f"error: {' '.join(str(error).split())}")


if __name__ == "__main__":
    main()

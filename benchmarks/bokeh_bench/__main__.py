"""Score a method on the benchmark's scenes: ``python -m benchmarks.bokeh_bench --method 'command {image}'``.

``README.md`` in this folder is for authors of methods. The first run traces the scenes into --folder.
"""

import argparse
import json
import platform
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bokeh_bench import VERSION
from benchmarks.bokeh_bench.running import SCORES, by_command, by_engine, score_scene
from benchmarks.bokeh_bench.scenes import SCENES, make_scene, prepare
from benchmarks.quality.theses import METHODS
from bokehnet.errors import BokehnetError, DataFileError
from bokehnet.io.files.atomic import write_text

_PINS = Path(__file__).with_name("pins.json")
_PACKAGES = ("bokehnet", "numpy", "numba", "scikit-image", "scipy", "embreex", "torch")


def _means(rows: list[dict[str, Any]]) -> dict[str, float]:
    return {key: float(np.mean([row[key] for row in rows])) for key in (*SCORES, "seconds")}


def _result(name: str, command: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    return {
        "benchmark": VERSION,
        "method": name,
        "command": command,
        "versions": {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
        "processor": platform.processor() or platform.machine(),
        "mean": _means(rows),
        "scenes": {scene: _means([row for row in rows if row["scene"] == scene]) for scene in scenes},
        "shots": rows,
    }


def _table(results: list[dict[str, Any]]) -> str:
    scenes = list(results[0]["scenes"])
    lines = [
        "| method | " + " | ".join(scenes) + " | mean, edge | PSNR | SSIM | FLIP | seconds |",
        "|---" * (len(scenes) + 6) + "|",
    ]
    for result in results:
        edges = " | ".join(f"{result['scenes'][scene]['edge_psnr']:.2f}" for scene in scenes)
        mean = result["mean"]
        lines.append(
            f"| {result['method']} | {edges} | {mean['edge_psnr']:.2f} | {mean['psnr']:.2f}"
            f" | {mean['ssim']:.4f} | {mean['flip']:.4f} | {mean['seconds']:.2f} |"
        )
    return "\n".join(lines)


def _read(path: Path) -> dict[str, Any]:
    try:
        result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if result["benchmark"] != VERSION or not result["scenes"]:
            raise ValueError(f"a result of benchmark {result['benchmark']}")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataFileError(f"{path}: expected a result of benchmark {VERSION}: {error}") from error
    return result


def _run(arguments: argparse.Namespace) -> None:
    if arguments.table:
        results = [_read(path) for path in arguments.table]
        if len({tuple(result["scenes"]) for result in results}) > 1:
            raise DataFileError("--table: expected results on the same scenes, found others")
        print(_table(results))
        return
    names = arguments.scene or list(SCENES)
    if arguments.pin:
        pins = {name: make_scene(name, arguments.folder / name)["summary"] for name in names}
        write_text(_PINS, json.dumps(pins, separators=(",", ":")) + "\n")
        return
    if arguments.method:
        methods = {arguments.name: (by_command(arguments.method), arguments.method)}
    else:
        methods = {name: (by_engine(name), f"--engine {name}") for name in arguments.engine or ["rays"]}
    pinned = json.loads(_PINS.read_text(encoding="utf-8"))
    prepare(arguments.folder, names, pinned, lambda line: print(line, file=sys.stderr, flush=True))
    results = []
    for name, (render, command) in methods.items():
        rows = [row for scene in names for row in score_scene(arguments.folder / scene, render)]
        results.append(_result(name, command, rows))
    print(_table(results))
    noise = [np.mean([row["truth_noise"][key] for row in rows]) for key in ("edge_psnr", "psnr")]
    print(f"\nNoise of the truth alone: {noise[0]:.2f} dB at edges, {noise[1]:.2f} dB over all")
    if arguments.json:
        content: Any = results[0] if len(results) == 1 else results
        write_text(arguments.json, json.dumps(content, indent=1) + "\n")


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bokeh_bench", description=__doc__)
    actions = parser.add_mutually_exclusive_group()
    actions.add_argument("--method", metavar="COMMAND", help="shell command with {image}, {depth} ... {out}")
    actions.add_argument(
        "--engine",
        action="append",
        choices=METHODS,
        help="engine or baseline of this package, in this process",
    )
    actions.add_argument(
        "--table", nargs="+", type=Path, metavar="JSON", help="results to print as one table"
    )
    actions.add_argument("--pin", action="store_true", help="trace the scenes again and pin the result")
    parser.add_argument("--name", default="command", help="with --method: name in the table")
    parser.add_argument(
        "--folder", type=Path, default=Path("bokeh_bench"), help="folder of the scenes; default %(default)s"
    )
    parser.add_argument("--scene", action="append", choices=SCENES, help="default: all")
    parser.add_argument("--json", type=Path, help="write the result to this file")
    try:
        _run(parser.parse_args())
    except BokehnetError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()

"""Command line: ``bokeh-bench run``, ``table``, ``page``, ``board`` and ``pin``; see ``README.md``."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bokeh_bench.dataset import TRACKS, make_scene, prepare
from bokeh_bench.files import BenchError
from bokeh_bench.leaderboard import add_to_board, read_results, run, table
from bokeh_bench.methods import BUILTIN, by_command, by_function
from bokeh_bench.page import write_page
from bokeh_bench.scenes import RECIPES

__all__ = ["main"]

PINS = Path(__file__).with_name("pins.json")
LEADERBOARD = Path(__file__).with_name("leaderboard.json")


def _report(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


def _run(arguments: argparse.Namespace) -> None:
    descriptions = prepare(
        arguments.folder, arguments.scene or list(RECIPES), json.loads(PINS.read_text()), _report
    )
    if arguments.command:
        method, about = by_command(arguments.command, descriptions), arguments.command
    elif arguments.function:
        method, about = by_function(arguments.function), arguments.function
    else:
        method, about = BUILTIN[arguments.builtin], f"builtin {arguments.builtin}"
    name = arguments.name or arguments.builtin or "method"
    tracks = arguments.track or list(TRACKS)
    result = run(name, about, method, arguments.folder, descriptions, tracks, arguments.pictures, _report)
    sys.stdout.write(table([result]) + "\n")
    shots = [shot["truth_noise"] for each in descriptions.values() for shot in each["shots"]]
    noise = {key: sum(shot[key] for shot in shots) / len(shots) for key in ("edge_psnr", "psnr")}
    sys.stdout.write(
        f"\nNoise of the truth: {noise['edge_psnr']:.2f} dB at edges, {noise['psnr']:.2f} dB over all\n"
    )
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def _results(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    return read_results(arguments.results or [LEADERBOARD])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="bokeh-bench", description="Benchmark of synthetic depth of field.")
    actions = parser.add_subparsers(dest="action", required=True)
    action = actions.add_parser("run", help="run a method on the scenes; the first run traces them")
    kinds = action.add_mutually_exclusive_group(required=True)
    kinds.add_argument("--command", help="shell command with {image}, {depth} ... {out}")
    kinds.add_argument("--function", metavar="MODULE:FUNCTION", help="Python function of a case")
    kinds.add_argument("--builtin", choices=BUILTIN, help="trivial method")
    action.add_argument("--name", help="name in the table")
    action.add_argument("--scene", action="append", choices=RECIPES, help="default: all")
    action.add_argument("--track", action="append", choices=TRACKS, help="default: all")
    action.add_argument("--json", type=Path, help="write the result to this file")
    action.add_argument("--pictures", type=Path, help="write 8-bit pictures to this folder")
    shown = actions.add_parser("table", help="print results as one table")
    shown.add_argument("results", nargs="*", type=Path, help="default: the leaderboard of this version")
    page = actions.add_parser("page", help="write a static HTML page with a slider")
    page.add_argument("results", nargs="+", type=Path)
    page.add_argument("--pictures", type=Path, required=True, help="folder of `run --pictures`")
    page.add_argument("--out", type=Path, required=True)
    board = actions.add_parser("board", help="write results into the leaderboard of this version")
    board.add_argument("results", nargs="+", type=Path)
    pin = actions.add_parser("pin", help="trace all scenes and pin them; for a new version")
    for each in (action, page, pin):
        each.add_argument(
            "--folder", type=Path, default=Path("bokeh_bench_scenes"), help="folder of the scenes"
        )
    return parser


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    options = _parser().parse_args(arguments)
    try:
        if options.action == "run":
            _run(options)
        elif options.action == "table":
            sys.stdout.write(table(_results(options)) + "\n")
        elif options.action == "board":
            add_to_board(LEADERBOARD, read_results(options.results))
        elif options.action == "page":
            path = write_page(_results(options), options.folder, options.pictures, options.out)
            sys.stdout.write(f"{path}\n")
        else:
            pins = {name: make_scene(name, options.folder / name)["pins"] for name in RECIPES}
            PINS.write_text(json.dumps(pins, separators=(",", ":")) + "\n", encoding="utf-8")
    except BenchError as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()

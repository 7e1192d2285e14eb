"""Runs of methods, their result files and the table of the leaderboard."""

import json
import platform
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from bokeh_bench import VERSION, scenes
from bokeh_bench.dataset import cases
from bokeh_bench.files import BenchError, read_picture, write_png
from bokeh_bench.methods import Method
from bokeh_bench.metrics import METRICS, edge_mask, scores
from bokeh_bench.tracing import blur_radius

__all__ = ["add_to_board", "read_results", "run", "table"]

_VERSIONS = {package: version(package) for package in ("numpy", "pillow")}


def _mean(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    return {key: round(float(np.mean([row[key] for row in rows])), 4) for key in (*METRICS, "seconds")}


def run(
    name: str,
    about: str,
    method: Method,
    folder: Path,
    descriptions: dict[str, dict[str, Any]],
    tracks: Sequence[str],
    pictures: Path | None,
    report: Callable[[str], None],
) -> dict[str, Any]:
    """Run a method on all cases and return its result.

    Args:
        name: Name in the table.
        about: Command or description of the method, for readers of the table.
        method: The method.
        folder: Folder of the scenes.
        descriptions: Descriptions of the scenes by name.
        tracks: Tracks to run.
        pictures: Folder for 8-bit pictures of each case; None writes none.
        report: Receives a line for each scene.

    Raises:
        BenchError: The method fails, or its picture has another size, NaN or infinity.
    """
    rows = []
    for scene, description in descriptions.items():
        report(f"{name}: {scene}")
        truths = [read_picture(folder / scene / f"truth_{k}.pfm") for k in range(len(description["shots"]))]
        exact = read_picture(folder / scene / "depth_exact.pfm").astype(np.float64)
        lenses = [scenes.camera(shot) for shot in scenes.draw(scene).shots]
        masks = [edge_mask(exact, blur_radius(lens, exact)) for lens in lenses]
        for track in tracks:
            for case in cases(folder / scene, description, track):
                start = time.perf_counter()
                picture = np.asarray(method(case))
                seconds = time.perf_counter() - start
                truth = truths[case.shot]
                if picture.shape != truth.shape or not np.isfinite(picture).all():
                    problem = "NaN or infinity" if picture.shape == truth.shape else f"{picture.shape}"
                    raise BenchError(
                        f"{name}: {scene}, shot {case.shot}, {track}: expected finite {truth.shape},"
                        f" found {problem}"
                    )
                row = scores(truth, picture, masks[case.shot])
                rows.append({"scene": scene, "shot": case.shot, "track": track, "seconds": seconds} | row)
                if pictures is not None:
                    pictures.mkdir(parents=True, exist_ok=True)
                    write_png(pictures / f"{name}_{scene}_{case.shot}_{track}.png", picture)
    by_track = {track: [row for row in rows if row["track"] == track] for track in tracks}
    return {
        "benchmark": VERSION,
        "method": name,
        "about": about,
        "versions": {"python": platform.python_version()} | _VERSIONS,
        "tracks": {track: _mean(group) for track, group in by_track.items()},
        "scenes": {
            scene: {t: _mean([r for r in group if r["scene"] == scene]) for t, group in by_track.items()}
            for scene in descriptions
        },
        "rows": rows,
    }


def read_results(paths: Sequence[Path]) -> list[dict[str, Any]]:
    """Read result files; a file holds one result or a list.

    Raises:
        BenchError: A file is no result of this version.
    """
    results: list[dict[str, Any]] = []
    for path in paths:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            for result in content if isinstance(content, list) else [content]:
                if result["benchmark"] != VERSION or not result["tracks"]:
                    raise ValueError(f"a result of benchmark {result['benchmark']}")
                results.append(result)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise BenchError(f"{path}: expected a result of benchmark {VERSION}: {error}") from error
    return results


def add_to_board(board: Path, results: Sequence[dict[str, Any]]) -> None:
    """Write the means of results into a leaderboard file; methods of other names and this version stay."""
    rows = json.loads(board.read_text(encoding="utf-8")) if board.is_file() else []
    kept = {row["method"]: row for row in rows if row["benchmark"] == VERSION}
    kept |= {each["method"]: {key: each[key] for key in each if key != "rows"} for each in results}
    board.write_text(json.dumps(list(kept.values()), indent=1) + "\n", encoding="utf-8")


def table(results: Sequence[dict[str, Any]]) -> str:
    """Return the leaderboard as Markdown, the best edge PSNR of the exact track first.

    Edge PSNR for each track; the other metrics are those of the first track.
    """
    tracks = list(dict.fromkeys(track for result in results for track in result["tracks"]))
    first = tracks[0]
    head = ["method", *tracks, "PSNR", "SSIM", "FLIP", "light"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for result in sorted(results, key=lambda each: -each["tracks"].get(first, {}).get("edge_psnr", 0)):
        edges = [
            f"{result['tracks'][track]['edge_psnr']:.2f}" if track in result["tracks"] else "–"
            for track in tracks
        ]
        mean = result["tracks"].get(first) or next(iter(result["tracks"].values()))
        others = [f"{mean['psnr']:.2f}", f"{mean['ssim']:.4f}", f"{mean['flip']:.4f}", f"{mean['light']:.2f}"]
        lines.append("| " + " | ".join([result["method"], *edges, *others]) + " |")
    return "\n".join(lines)

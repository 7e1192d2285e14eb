"""Results of ``benchmarks.quality.theses`` as one table by method, and reasons for missing rows."""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.figures import write_figures
from benchmarks.quality.scenes.fault_probes import FAULTS

__all__ = ["Figures", "merged", "table", "write_tables"]

_COMMAND = "python -m benchmarks.quality.theses --figures docs/figures"

# ``faults`` and ``costs``: method -> values; ``scenes``: scene -> method -> values.
Figures = dict[str, dict[str, Any]]

# Methods that are not engines, and the commands that measure them.
_NEED_GEOMETRY = {
    "selective_rays": "python -m benchmarks.experiments.edges.selective_rays",
    "mesh_views": "python -m benchmarks.experiments.edges.level_of_detail",
}

_COSTS = {"seconds": ".2f", "memory": ".0f", "flicker": ".2f"}


def merged(runs: list[Figures]) -> Figures:
    """Merge the figures of several runs; later runs take precedence."""
    figures: Figures = {"faults": {}, "costs": {}, "scenes": {}}
    for run in runs:
        for part in ("faults", "costs"):
            figures[part].update(run.get(part, {}))
        for scene, rows in run.get("scenes", {}).items():
            figures["scenes"].setdefault(scene, {}).update(rows)
    return figures


def table(figures: Figures, methods: tuple[str, ...]) -> str:
    """Return Markdown: scores of each scene and their means, costs and faults; a dash means not run.

    Args:
        figures: Figures by part, scene and method.
        methods: Names in the order of the rows; those without any figure are omitted.
    """
    scenes, costs, faults = (figures.get(part, {}) for part in ("scenes", "costs", "faults"))
    present = [
        name
        for name in methods
        if name in costs or name in faults or any(name in rows for rows in scenes.values())
    ]
    head = ["method", *scenes, "mean", *_COSTS, *FAULTS]
    lines = [_line(head), "|---" * len(head) + "|"]
    for name in present:
        scores = [rows[name] for rows in scenes.values() if name in rows]
        cells = [_scores([rows[name]]) if name in rows else "-" for rows in scenes.values()]
        cells.append(_scores(scores) if scores and len(scores) == len(scenes) else "-")
        cells += [format(costs[name][key], form) if name in costs else "-" for key, form in _COSTS.items()]
        cells += [f"{round(faults[name][key], 1) + 0.0:.1f}" if name in faults else "-" for key in FAULTS]
        lines.append(_line([name, *cells]))
    lines += [
        "",
        "Scenes and mean: edge PSNR / PSNR / FLIP; memory: bytes a pixel; flicker and on: per cent.",
    ]
    for name, command in _NEED_GEOMETRY.items():
        lines.append(f"{name}: no row, as it draws a scene and not a picture; {command} has its own.")
    return "\n".join(lines)


def write_tables(folder: Path, figures: Figures, methods: tuple[str, ...], shots: int | None) -> None:
    """Write ``theses_scenes.json`` and ``theses_faults.json`` with all methods that have every figure."""
    scenes, costs, faults = (figures[part] for part in ("scenes", "costs", "faults"))
    columns = {name: (name.split("_", 1)[1].replace("_", " "), ".2f") for name in scenes}
    columns |= {"edge": ("mean edge", ".2f"), "psnr": ("mean all", ".2f"), "flip": ("FLIP", ".4f")}
    rows = {}
    for method in methods:
        if all(method in scene for scene in scenes.values()):
            scores = [scene[method] for scene in scenes.values()]
            means = {key: float(np.mean([row[key] for row in scores])) for key in ("edge", "psnr", "flip")}
            rows[method] = {name: scene[method]["edge"] for name, scene in scenes.items()} | means
    conditions = f"means over {shots or 5} shots each, clipped sRGB; PSNR in dB, of a scene at depth steps"
    write_figures(folder / "theses_scenes.json", _COMMAND, conditions, columns, rows)

    columns = {"seconds": ("processor seconds", ".2f"), "memory": ("bytes per pixel", ".0f")}
    columns |= {"flicker": ("flicker, %", ".2f")} | {key: (f"{key}, %", "z.1f") for key in FAULTS}
    rows = {name: costs[name] | faults[name] for name in methods if name in costs and name in faults}
    conditions = "time and memory at 512x384 pixels, discs up to 16 px; faults on probes"
    write_figures(folder / "theses_faults.json", _COMMAND, conditions, columns, rows)


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _scores(rows: list[dict[str, float]]) -> str:
    edge, all_pixels, flip = (float(np.mean([row[key] for row in rows])) for key in ("edge", "psnr", "flip"))
    return f"{edge:.2f} / {all_pixels:.2f} / {flip:.4f}"

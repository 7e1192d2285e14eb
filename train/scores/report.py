"""Tables of the scores of many renders."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from train.data.degradation import DEGRADED
from train.scores.metrics import BANDS, band_label

__all__ = ["TABLES", "Row", "as_json", "differences", "excess", "format_table", "mean_rows"]

_LABELS = [band_label(band) for band in BANDS]

# Title -> columns; columns that no row has are omitted.
TABLES = {
    "all pixels": ("psnr", "ssim", "ms_ssim", "flip", "log_psnr", "excess_psnr"),
    "edge pixels": ("edge_psnr", "edge_ssim", "edge_flip", "excess_edge_psnr", "step_psnr"),
    "outside edges": ("flat_psnr", "flat_psnr_gain", "flat_psnr_like"),
    "PSNR by blur radius (px), all pixels": tuple(f"psnr_{label}" for label in _LABELS),
    "PSNR by blur radius (px), edge pixels": tuple(f"edge_psnr_{label}" for label in _LABELS),
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Row:
    """Scores of one method with one kind of disparity, of one render or their means."""

    method: str
    disparity: str
    scores: dict[str, float]


def _mean(scores: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the mean of each score without NaN, or NaN if no row has it."""
    columns = {key: [row[key] for row in scores if not math.isnan(row[key])] for key in scores[0]}
    return {key: float(np.mean(values)) if values else math.nan for key, values in columns.items()}


def mean_rows(rows: Sequence[Row]) -> list[Row]:
    """Return the means over all renders per method and disparity, plus ``degraded``, over three of them."""
    groups: dict[tuple[str, str], list[dict[str, float]]] = {}
    for row in rows:
        groups.setdefault((row.method, row.disparity), []).append(row.scores)
    means = {key: _mean(scores) for key, scores in groups.items()}
    for method in dict.fromkeys(row.method for row in rows):
        wrong = [means[method, kind] for kind in DEGRADED if (method, kind) in means]
        if len(wrong) == len(DEGRADED):
            means[method, "degraded"] = _mean(wrong)
    kinds = list(dict.fromkeys(kind for _, kind in means))
    return [
        Row(method=method, disparity=kind, scores=scores)
        for (method, kind), scores in sorted(means.items(), key=lambda item: kinds.index(item[0][1]))
    ]


def excess(rows: Sequence[Row], floor: dict[str, float]) -> list[Row]:
    """Add ``excess_X``: score X after subtraction of the truth's noise from the mean squared error, dB.

    Args:
        rows: Mean scores.
        floor: PSNR of the noise alone for each score X, dB; the result is NaN where the error is not above
            it.
    """

    def add(scores: dict[str, float]) -> dict[str, float]:
        excesses = {}
        for key, noise in floor.items():
            error = 10 ** (-scores[key] / 10) - 10 ** (-noise / 10)
            excesses[f"excess_{key}"] = -10 * math.log10(error) if error > 0 else math.nan
        return scores | excesses

    return [Row(method=row.method, disparity=row.disparity, scores=add(row.scores)) for row in rows]


def differences(rows: Sequence[Row], baseline: str) -> list[Row]:
    """Return the differences of each method to ``baseline`` on the same disparity."""
    base = {row.disparity: row.scores for row in rows if row.method == baseline}
    return [
        Row(
            method=row.method,
            disparity=row.disparity,
            scores={key: value - base[row.disparity][key] for key, value in row.scores.items()},
        )
        for row in rows
        if row.method != baseline
    ]


def _cell(column: str, value: float, signed: bool) -> str:
    if math.isnan(value):
        return "-"
    digits = 2 if "psnr" in column else 4
    return f"{value:{'+' if signed else ''}.{digits}f}"


def format_table(
    title: str, columns: Sequence[str], rows: Sequence[Row], *, markdown: bool, signed: bool = False
) -> str:
    """Return one table, or an empty string if no row has any of ``columns``."""
    empty = dict.fromkeys(columns, math.nan)
    present = [c for c in columns if any(not math.isnan((empty | row.scores)[c]) for row in rows)]
    if not present:
        return ""
    names = [column.removeprefix("edge_psnr_").removeprefix("psnr_") for column in present]
    cells = [["method", "disparity", *names]]
    for row in rows:
        values = [_cell(column, row.scores[column], signed) for column in present]
        cells.append([row.method, row.disparity, *values])
    if markdown:
        cells.insert(1, ["---"] * 2 + ["---:"] * len(present))
        lines = [f"**{title}**", ""] + [f"| {' | '.join(line)} |" for line in cells]
    else:
        widths = [max(len(line[i]) for line in cells) for i in range(len(cells[0]))]
        lines = [title]
        for line in cells:
            left = [text.ljust(width) for text, width in zip(line[:2], widths[:2], strict=True)]
            right = [text.rjust(width) for text, width in zip(line[2:], widths[2:], strict=True)]
            lines.append("  ".join(left + right).rstrip())
    return "\n".join(lines)


def as_json(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the rows for a JSON file, with ``None`` in place of NaN."""
    return [
        {
            "method": row.method,
            "disparity": row.disparity,
            **{key: None if math.isnan(value) else value for key, value in row.scores.items()},
        }
        for row in rows
    ]

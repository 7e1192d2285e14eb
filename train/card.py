"""Write the tables of the model card: the networks and their scores.

``python -m train.card --networks bokehnet/weights/hybrid --scores runs/scores.json --out runs/card.md``
"""

import argparse
import json
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bokehnet.errors import BokehnetError, DataFileError
from bokehnet.io.files.atomic import write_text
from bokehnet.models.onnx_import import read_exported
from train.scores.report import Row, format_table

__all__ = ["main", "network_rows", "score_table"]

# Columns of the score table.
_COLUMNS = ("psnr", "ssim", "edge_psnr", "edge_ssim", "flip")


def network_rows(folder: Path) -> list[list[str]]:
    """Return the cells of each network of a folder.

    Raises:
        DataFileError: The manifest is missing or incomplete.
        ModelFileError: A network does not match the manifest.
    """
    path = folder / "manifest.json"
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        rows = []
        for name, entry in manifest["networks"].items():
            note = manifest["notes"][name]
            _, constants = read_exported(folder, name)
            weights = sum(x.numel() for key, x in constants.items() if key.endswith((".weight", ".bias")))
            size = (folder / entry["file"]).stat().st_size
            data = note["run"]["data"]
            sets = ", ".join(dict.fromkeys(Path(x).name for x in (data["folder"], *data.get("also", ()))))
            start = Path(note["run"].get("start") or "nothing")
            start = start.parent if start.suffix == ".pt" else start
            cells = [f"{folder.name}/", name, f"{weights / 1e6:.2f} M", f"{size / 1e6:.1f} MB"]
            rows.append([*cells, f"{note['steps']} of {data['batch_size']}", sets, start.name])
        return rows
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, BokehnetError):
            raise
        raise DataFileError(
            f"{path}: expected a manifest with the runs of the networks ({error}); run "
            "python -m train.export again"
        ) from error


def score_table(path: Path) -> str:
    """Return a table of the means in a file that ``train.evaluate --json`` wrote.

    Raises:
        DataFileError: It is not such a file.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        rows = [_row(entry) for entry in content["means"]]
        count = len(content["pictures"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataFileError(
            f"{path}: expected scores ({error}); run python -m train.evaluate again"
        ) from error
    return format_table(f"{path.stem}, pictures: {count}", _COLUMNS, rows, markdown=True)


def _row(entry: dict[str, Any]) -> Row:
    scores = {key: math.nan if entry.get(key) is None else float(entry[key]) for key in _COLUMNS}
    method = re.sub(r":[^+]*/", ":", str(entry["method"]))  # networks by the base name of their folder
    return Row(method=method, disparity=str(entry["disparity"]), scores=scores)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", type=Path, action="append", default=[], help="folder of networks")
    parser.add_argument(
        "--scores", type=Path, action="append", default=[], help="file of train.evaluate --json"
    )
    parser.add_argument("--out", type=Path, required=True, help="Markdown file to write")
    options = parser.parse_args(arguments)
    try:
        names = ["folder", "network", "weights", "file", "steps", "trained on", "started from"]
        rows = [names, ["---"] * len(names)]
        for folder in options.networks:
            rows += network_rows(folder)
        text = "\n".join(f"| {' | '.join(row)} |" for row in rows)
        tables = [table for path in options.scores if (table := score_table(path))]
        write_text(options.out, "\n\n".join([text, *tables]) + "\n", error=DataFileError)
    except BokehnetError as error:
        sys.exit(f"error: {' '.join(str(error).split())}")
    print(f"done: {options.out}")


if __name__ == "__main__":
    main()

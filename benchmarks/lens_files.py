"""Lens files of other programs: ``python -m benchmarks.lens_files FOLDER [--glasses FOLDER]``.

Each file of the folder is read; focal length and f-number stand beside those that optiland and ray-optics,
where they are installed, say of the same file. They tell lengths in the unit of the file, we in mm.
"""

import argparse
import contextlib
import io
import logging
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bokehnet.errors import BokehnetError
from bokehnet.lenses.files.reading import LENS_FILES, import_lens
from bokehnet.lenses.pupils import paraxial_lens

__all__ = ["main"]


def _ours(path: Path, glasses: list[Path]) -> tuple[float, float]:
    found = import_lens(path, glasses).prescription
    gauss = paraxial_lens(found.trace_surfaces(found.design_wavelength))
    focal_length = float(gauss.cardinal.focal_length)
    return focal_length, abs(focal_length / gauss.entrance.radius / 2)


def _optiland(path: Path) -> tuple[float, float]:
    from optiland import fileio  # type: ignore[import-not-found]

    readers = {".json": "load_optiland_file", ".zmx": "load_zemax_file", ".seq": "load_codev_file"}
    lens: Any = getattr(fileio, readers[path.suffix.lower()])(str(path))
    return float(lens.paraxial.f2()), abs(float(lens.paraxial.f2()) / float(lens.paraxial.EPD()))


def _rayoptics(path: Path) -> tuple[float, float]:
    if path.suffix.lower() == ".json":
        raise KeyError(path.suffix)
    from rayoptics.gui.appcmds import open_model  # type: ignore[import-not-found]

    data = open_model(str(path))["analysis_results"]["parax_data"].fod
    return float(data.efl), abs(float(data.efl / data.enp_radius / 2))


def _cell(tool: Callable[[Path], tuple[float, float]], path: Path, ours: tuple[float, float]) -> str:
    """How far a tool is from ours, or that it fails."""
    hidden = io.StringIO()
    try:
        with contextlib.redirect_stdout(hidden), contextlib.redirect_stderr(hidden):
            theirs = tool(path)
        return ", ".join(f"{abs(a / b - 1):.0e}" for a, b in zip(theirs, ours, strict=True))
    except Exception as error:  # whatever another program raises
        return f"- ({type(error).__name__})"


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--glasses", type=Path, action="append", default=[])
    arguments = parser.parse_args()
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    paths = [path for path in sorted(arguments.folder.iterdir()) if path.suffix.lower() in LENS_FILES]
    print("| file | focal length | f-number | optiland: off by | ray-optics: off by |")
    print("|---|---|---|---|---|")
    read = 0
    for path in paths:
        try:
            ours = _ours(path, arguments.glasses)
        except BokehnetError as error:
            print(f"| {path.name} | {str(error).replace(str(path), '').strip(', :')} | | | |")
            continue
        read += 1
        off = " | ".join(_cell(tool, path, ours) for tool in (_optiland, _rayoptics))
        print(f"| {path.name} | {ours[0]:.6f} | {ours[1]:.5f} | {off} |", flush=True)
    print(f"{read} of {len(paths)} files are read")


if __name__ == "__main__":
    main()

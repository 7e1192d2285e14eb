"""Figures of matplotlib as files: of known formats, checked before anything is drawn, never half written."""

from pathlib import Path
from typing import TYPE_CHECKING

from bokehnet.io.atomic import check_target, write_atomic
from bokehnet.io.output_format import check_extension

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FIGURE_EXTENSIONS", "check_figure", "write_figure"]

# What matplotlib draws and Pillow encodes.
FIGURE_EXTENSIONS = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")


def check_figure(path: Path | str, extensions: tuple[str, ...] = FIGURE_EXTENSIONS) -> None:
    """Raise ``ImageFileError`` unless a figure could be written there; call it before any long work.

    Args:
        path: Where it shall go.
        extensions: The known ones, lower case.
    """
    check_extension(Path(path), extensions)
    check_target(path)


def write_figure(figure: "Figure", path: Path | str, dpi: int) -> None:
    """Write a figure; an older file survives until the new one is complete.

    Raises:
        ImageFileError: The file cannot be written, or its ending names no known format.
    """
    check_figure(path)
    write_atomic(path, lambda temporary: figure.savefig(temporary, dpi=dpi))

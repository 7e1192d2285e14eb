"""Write matplotlib figures to files, atomically and only in known formats."""

from pathlib import Path
from typing import TYPE_CHECKING

from bokehnet.io.files.atomic import write_atomic
from bokehnet.io.formats.output_format import check_extension

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FIGURE_EXTENSIONS", "write_figure"]

# Formats that matplotlib and Pillow write; for ``check_writable`` before anything is drawn.
FIGURE_EXTENSIONS = (".png", ".pdf", ".svg", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")


def write_figure(figure: "Figure", path: Path | str, dpi: int) -> None:
    """Write a figure; an existing file remains until the new one is complete.

    Raises:
        ImageFileError: The file cannot be written, or its extension is unknown.
    """
    check_extension(Path(path), FIGURE_EXTENSIONS)
    write_atomic(path, lambda temporary: figure.savefig(temporary, dpi=dpi))

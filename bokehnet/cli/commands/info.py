"""``bokehnet info``: what is in an image file."""

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["info"]


def info(
    file: Annotated[Path, typer.Argument(help="JPEG, PNG, TIFF, WebP, JPEG XL, EXR, HDR or PFM file.")],
) -> None:
    """Say what is in an image: size, channels, colour space, depth range."""
    from bokehnet.cli.progress import progress  # after parsing, so --help stays fast
    from bokehnet.io.info import image_info

    with progress("reading", counted=False) as report:
        found = image_info(file, report)
    turned = "" if found.orientation == 1 else f" (turned upright, EXIF orientation {found.orientation})"
    space = found.color_space
    decoded = space if space == "linear" else f"{space} as a picture, unchanged as a map"
    if found.refusal:
        decoded = f"no picture ({found.refusal.removeprefix(f'{file}: ')}); unchanged as a map"
    parts = "" if found.parts == 1 else f" in {found.parts} parts"
    rows = {
        "format": found.file_format,
        "size": f"{found.width} x {found.height} pixels{turned}",
        "channels": f"{' '.join(found.channels)} ({found.pixel_type}){parts}",
        "read as": decoded,
    }
    for name, values in found.ranges.items():
        odd = [
            f"{count} {what}" for count, what in ((values.infinite, "infinite"), (values.nan, "NaN")) if count
        ]
        rows[f"range of {name}"] = ", ".join([f"{values.lowest:g} to {values.highest:g}", *odd])
    width = max(map(len, rows))
    typer.echo(file)
    for label, text in rows.items():
        typer.echo(f"  {label:<{width}}  {text}")

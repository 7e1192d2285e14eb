"""``bokehnet info``: description of an image file."""

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["info"]


def info(
    file: Annotated[
        Path, typer.Argument(help="Image file: JPEG, PNG, TIFF, WebP, JPEG XL, EXR, HDR or PFM.")
    ],
) -> None:
    """Print size, channels, colour space and depth range of an image."""
    from bokehnet.cli.progress import progress  # after parsing, so --help stays fast
    from bokehnet.io.info import image_info

    with progress("reading", counted=False) as report:
        description = image_info(file, report)
    orientation = description.orientation
    turned = "" if orientation == 1 else f" (rotated upright, EXIF orientation {orientation})"
    space = description.color_space
    decoded = space if space == "linear" else f"{space} as a picture, unchanged as a map"
    if description.refusal:
        decoded = f"no picture ({description.refusal.removeprefix(f'{file}: ')}); unchanged as a map"
    parts = "" if description.parts == 1 else f" in {description.parts} parts"
    rows = {
        "format": description.file_format,
        "size": f"{description.width} x {description.height} pixels{turned}",
        "channels": f"{' '.join(description.channels)} ({description.pixel_type}){parts}",
        "read as": decoded,
    }
    if description.pixel_aspect != 1:
        rows["pixels"] = f"{description.pixel_aspect:.4g} times as wide as high"
    for name, values in description.ranges.items():
        non_finite = [
            f"{count} {kind}" for count, kind in ((values.infinite, "infinite"), (values.nan, "NaN")) if count
        ]
        rows[f"range of {name}"] = ", ".join([f"{values.lowest:g} to {values.highest:g}", *non_finite])
    width = max(map(len, rows))
    typer.echo(file)
    for label, text in rows.items():
        typer.echo(f"  {label:<{width}}  {text}")

"""``bokehnet info``: description of an image file."""

from pathlib import Path

import click

from bokehnet.cli.parser import PATH, SectionedCommand, argument

__all__ = ["info"]


@click.command(cls=SectionedCommand)
@argument("file", type=PATH, help="Image file: JPEG, PNG, TIFF, WebP, JPEG XL, HEIC, EXR, HDR, PFM or NumPy.")
def info(
    file: Path,
) -> None:
    """Print size, channels, colours, depth and gain map of an image."""
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
    for name, text in (("depth map", description.depth_map), ("gain map", description.gain_map)):
        if text:
            rows[name] = text
    for name, values in description.ranges.items():
        non_finite = [
            f"{count} {kind}" for count, kind in ((values.infinite, "infinite"), (values.nan, "NaN")) if count
        ]
        rows[f"range of {name}"] = ", ".join([f"{values.lowest:g} to {values.highest:g}", *non_finite])
    width = max(map(len, rows))
    click.echo(file)
    for label, text in rows.items():
        click.echo(f"  {label:<{width}}  {text}")

"""Options of ``bokehnet render`` about the map of the scene, and about what stays sharp."""

from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "Blur",
    "Channel",
    "Depth",
    "DepthUnit",
    "Disparity",
    "DisparityRange",
    "FNumber",
    "FocalLength",
    "FocusAt",
    "FocusDistance",
    "FocusRange",
    "FocusValue",
    "Invert",
    "MixedDepth",
    "RefineDisparity",
    "ResizeDisparity",
    "SensorWidth",
]

Disparity = Annotated[Path | None, typer.Option(help="Disparity map, near is bright; normalised to 0..1.")]
Depth = Annotated[
    Path | None,
    typer.Option(help="EXR with metric depth. Without --disparity and --depth: what a phone's photo holds."),
]
Channel = Annotated[str | None, typer.Option(help="Channel of the map in its EXR; default: Z.")]
DepthUnit = Annotated[
    str | None, typer.Option(metavar="UNIT", help="With --depth: m (default), cm, mm, in, ft or 1/m.")
]
Invert = Annotated[bool, typer.Option("--invert", help="With --disparity: far is bright, as in 0..1 depth.")]
DisparityRange = Annotated[
    str | None,
    typer.Option(
        metavar="A,B",
        help="With --disparity: values that count as 0 and 1; default: the lowest and the highest, "
        "of a sequence 0 and 1.",
    ),
]
ResizeDisparity = Annotated[
    bool, typer.Option("--resize-disparity", help="Bring a map of another size to the picture's.")
]
MixedDepth = Annotated[
    str,
    typer.Option(
        metavar="auto|on|off",
        help="Mend values between two surfaces at edges; auto: in --depth, where there are many.",
    ),
]
RefineDisparity = Annotated[
    str,
    typer.Option(
        metavar="auto|on|off",
        help="Move the map's edges to the picture's; auto: where they are out of place.",
    ),
]

FocusValue = Annotated[
    float | None, typer.Option("--focus", help="With --disparity: what stays sharp, 0..1.")
]
FocusDistance = Annotated[float | None, typer.Option(help="With --depth: what stays sharp, metres.")]
FocusAt = Annotated[str | None, typer.Option(metavar="X,Y", help="Focus on this pixel, from the upper left.")]
FocusRange = Annotated[
    str | None,
    typer.Option(
        metavar="NEAR,FAR",
        help="All between stays sharp, blur grows from both ends; metres with --depth, else 0..1.",
    ),
]
Blur = Annotated[
    float | None, typer.Option(help="With --disparity: blur radius in pixels per unit of disparity.")
]
FocalLength = Annotated[
    float | None, typer.Option(help="With --depth, mm. These three: default, what the picture's file says.")
]
FNumber = Annotated[float | None, typer.Option(help="With --depth or a phone's photo.")]
SensorWidth = Annotated[float | None, typer.Option(help="With --depth, mm.")]

"""Options of ``bokehnet render`` that lean the plane of focus, as a tilted lens does."""

from typing import Annotated

import typer

__all__ = ["FocusPlane", "TiltX", "TiltY"]

TiltX = Annotated[
    float,
    typer.Option(
        metavar="DEG",
        help="Lean the plane of focus: above 0 the upper side focuses nearer, below 0 the lower side, as a "
        "lens tilted down. With --depth the lens's tilt; with --disparity 45 leads from far to near.",
    ),
]
TiltY = Annotated[
    float, typer.Option(metavar="DEG", help="Likewise: above 0 the right focuses nearer, below 0 the left.")
]
FocusPlane = Annotated[
    tuple[str, str, str] | None,
    typer.Option(
        metavar="X1,Y1 X2,Y2 X3,Y3", help="Lean the plane of focus through what these three pixels show."
    ),
]

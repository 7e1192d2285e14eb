"""Sequences of frames: options of ``bokehnet render`` and the pull that they describe."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.errors import ParameterError

if TYPE_CHECKING:
    from bokehnet.cli.pull import Pull

__all__ = [
    "BlurFrom",
    "BlurTo",
    "FNumberFrom",
    "FNumberTo",
    "FocusFrom",
    "FocusTo",
    "Frames",
    "Jobs",
    "Overwrite",
    "PullFile",
    "make_pull",
]

Frames = Annotated[
    str | None,
    typer.Option(
        metavar="RANGE",
        help="Render a sequence, such as 1001-1100 or 1001-1100x2; #### or %04d in names is the frame.",
    ),
]
Jobs = Annotated[
    int | None, typer.Option(min=1, help="With --frames: how many are rendered at a time; default 1.")
]
Overwrite = Annotated[
    bool, typer.Option("--overwrite", help="With --frames: render again what is there; default: skip it.")
]
FocusFrom = Annotated[
    float | None,
    typer.Option(help="With --frames: focus of the first frame, metres with --depth, 0..1 with --disparity."),
]
FocusTo = Annotated[float | None, typer.Option(help="Focus of the last frame; even in disparity between.")]
FNumberFrom = Annotated[float | None, typer.Option(help="With --frames: f-number of the first frame.")]
FNumberTo = Annotated[float | None, typer.Option(help="F-number of the last frame; even in blur between.")]
BlurFrom = Annotated[float | None, typer.Option(help="With --frames: --blur of the first frame.")]
BlurTo = Annotated[float | None, typer.Option(help="Blur of the last frame.")]
PullFile = Annotated[
    Path | None,
    typer.Option(
        "--pull",
        metavar="FILE.csv",
        help="With --frames: columns frame and focus, focus_distance, f_number, blur; even between its rows.",
    ),
]


def make_pull(
    frames: Sequence[int], ends: Mapping[str, tuple[float | None, float | None]], file: Path | None
) -> "Pull":
    """Return what changes over the frames.

    Args:
        frames: Rising.
        ends: Name to its values at the first and the last frame; both may be ``None``.
        file: CSV file; None where none was given.

    Raises:
        ParameterError: One end without the other, or ends beside a file.
        ConfigError: As :func:`bokehnet.cli.pull.read_pull`.
    """
    from bokehnet.cli.pull import Pull, read_pull

    given = {name: values for name, values in ends.items() if values != (None, None)}
    if file is not None:
        if given:
            raise ParameterError(
                "expected one of --pull and the options that end in -from and -to, found both"
            )
        return read_pull(file)
    keys = {}
    for name, (first, last) in given.items():
        if first is None or last is None:
            option = "--focus" if name.startswith("focus") else f"--{name.replace('_', '-')}"
            raise ParameterError(f"expected both {option}-from and {option}-to, found one")
        keys[name] = [(frames[0], first), (frames[-1], last)]
    return Pull(keys=keys)

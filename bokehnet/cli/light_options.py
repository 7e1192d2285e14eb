"""How light is weighed before blurring: options of ``bokehnet render`` and what is made of them."""

from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.cli.naming import named_options
from bokehnet.errors import ParameterError

if TYPE_CHECKING:
    from bokehnet.optics.tone import Highlights

__all__ = ["Gamma", "HighlightGain", "HighlightThreshold", "make_highlights"]

Gamma = Annotated[
    float, typer.Option(help="Above 1 bright pixels prevail where light mixes, 0.2 to 5; 1 is a real lens.")
]
HighlightThreshold = Annotated[
    float | None,
    typer.Option(
        "--highlights",
        metavar="THRESHOLD",
        help="Brighten clipped lights before blurring: linear light above this, 0 to below 1, is expanded.",
    ),
]
HighlightGain = Annotated[
    float | None, typer.Option(metavar="GAIN", help="With --highlights: what white becomes; default 8.")
]

_OPTIONS = {"threshold": "--highlights", "gain": "--highlight-gain"}


def make_highlights(threshold: float | None, gain: float | None) -> "Highlights | None":
    """Return the expansion that the options describe; ``ParameterError`` tells a wrong one."""
    if threshold is None:
        if gain is not None:
            raise ParameterError("--highlight-gain needs --highlights")
        return None
    from bokehnet.optics.tone import Highlights  # after parsing, so --help stays fast

    with named_options(_OPTIONS):
        return Highlights(threshold=threshold) if gain is None else Highlights(threshold=threshold, gain=gain)

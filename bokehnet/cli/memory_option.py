"""The option that bounds memory."""

import re
from typing import Annotated

import typer

from bokehnet.errors import ParameterError

__all__ = ["PROGRAM", "MaxMemory", "parse_bytes"]

# Bytes that the program takes before it holds a picture: libraries, kernels, buffers of the decoders.
PROGRAM = 560 * 2**20

MaxMemory = Annotated[
    str | None,
    typer.Option(
        metavar="SIZE",
        help="Memory for all, pictures included, such as 4G; what does not fit is rendered in strips.",
    ),
]

_SIZE = re.compile(r"(\d{1,9}(?:\.\d{1,9})?)\s*([KMGT]?)(?:i?B)?", re.IGNORECASE)
_UNITS = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}


def parse_bytes(text: str) -> int:
    """Return the bytes of ``500M`` or ``1.5G`` (powers of 1024); ``ParameterError`` where it is none."""
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise ParameterError(f"--max-memory: expected a size such as 500M or 2G, got {text!r}")
    return int(float(match[1]) * _UNITS[match[2].upper()])

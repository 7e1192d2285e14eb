"""From the settings of the output to what the files are to be like."""

from pathlib import Path
from typing import Any

from bokehnet.io.frame import Frame, check_frame_format
from bokehnet.io.output_format import OutputFormat, check_format
from bokehnet.settings.error_names import errors_named_as
from bokehnet.settings.settings import OutputSettings

__all__ = ["check_output", "make_output_format"]


def make_output_format(settings: OutputSettings) -> OutputFormat:
    """Return what a written picture is to be like.

    Examples:
        >>> make_output_format(OutputSettings(bits="16", dither="off")).bits
        16
    """
    bits: Any = int(settings.bits) if settings.bits in ("8", "10", "16") else settings.bits
    return OutputFormat(
        color_space=settings.color_space,
        bits=bits,
        quality=settings.quality,
        subsampling=settings.subsampling,
        dither=settings.dither == "on",
    )


def check_output(path: Path, settings: OutputSettings, frame: Frame | None = None) -> None:
    """Raise unless a file can be as the settings say; nothing is touched.

    Args:
        path: Where the picture goes.
        settings: What it is to be like.
        frame: The picture that it is made of, where it is read already.

    Raises:
        ImageFileError: The format is not written here, or cannot tell the picture's colours.
        ParameterError: It has no such bits or colour space.

    Examples:
        >>> check_output(Path("out.jpg"), OutputSettings(bits="16"))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: output.bits: expected 8 for .jpg, got 16; write .png or .tif or ...
    """
    with errors_named_as("output"):
        wanted = make_output_format(settings)
        check_format(path, wanted)
        if frame is not None:
            check_frame_format(path, frame, wanted)

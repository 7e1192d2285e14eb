"""Conversion of output settings to the format of written files."""

from pathlib import Path
from typing import Any

from bokehnet.errors import ErrorCollector, ParameterError
from bokehnet.io.formats.output_format import IMAGE_EXTENSIONS, OutputFormat, check_format
from bokehnet.io.frame import Frame, check_frame_format
from bokehnet.settings.error_names import errors_named_as
from bokehnet.settings.fields import field_settings
from bokehnet.settings.settings import OutputSettings

__all__ = ["check_lossy_options", "check_output", "make_output_format"]


# Extensions of the formats that have a setting; in all others it has no effect.
_EXTENSIONS_WITH = {
    "quality": (".jpg", ".jpeg", ".webp", ".jxl", ".avif", ".heic", ".heif"),
    "subsampling": (".jpg", ".jpeg", ".avif", ".heic", ".heif"),
}


def make_output_format(settings: OutputSettings) -> OutputFormat:
    """Return the format of a written picture.

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
        shoulder=settings.shoulder == "on",
    )


def check_output(path: Path, settings: OutputSettings, frame: Frame | None = None) -> None:
    """Raise unless a file can be written according to the settings; writes nothing.

    Args:
        path: Output file.
        settings: Output settings.
        frame: Input picture, if already read.

    Raises:
        ImageFileError: The format is not supported, or cannot store the picture's colour space.
        ParameterError: The format does not support the bit depth or the colour space.

    Examples:
        >>> check_output(Path("out.jpg"), OutputSettings(bits="16"))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: output.bits: expected 8 for .jpg, got 16; write .png or .tif or ...
    """
    with errors_named_as("output"):
        output_format = make_output_format(settings)
        check_format(path, output_format)
        if frame is not None:
            check_frame_format(path, frame, output_format)


def check_lossy_options(path: Path, settings: OutputSettings) -> None:
    """Raise ``ParameterError`` if a setting of quality has no effect in a format; the default always passes.

    Args:
        path: Output file.
        settings: Output settings.

    Examples:
        >>> check_lossy_options(Path("out.exr"), OutputSettings(subsampling="4:2:0"))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: output.subsampling: expected nothing for .exr, which has none, ...
    """
    extension = path.suffix.lower()
    errors = ErrorCollector()
    for name, extensions in _EXTENSIONS_WITH.items():
        value = getattr(settings, name)
        with errors.collect():
            if extension not in extensions and value != field_settings(OutputSettings)[name].default:
                expected = f"nothing for {extension}, which has none"
                remedy = "leave it out, or write .jpg" if extension in IMAGE_EXTENSIONS else "leave it out"
                raise ParameterError(f"output.{name}", expected, value, remedy, shown=f"{value}")
    errors.raise_all()

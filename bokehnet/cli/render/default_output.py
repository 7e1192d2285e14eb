"""Name of the result where ``--output`` is absent."""

from pathlib import Path

__all__ = ["default_output"]

# Extension of the result of a picture whose format cannot be written.
_FALLBACK = ".jpg"


def default_output(picture: Path, extensions: tuple[str, ...]) -> Path:
    """Return ``photo_bokeh.jpg`` beside ``photo.jpg``; with a number if a file has that name already.

    Args:
        picture: File of the picture or video.
        extensions: Extensions that can be written, lower case; others become ``.jpg``.

    Examples:
        >>> Path("photo_bokeh.png").touch()
        >>> default_output(Path("photo.png"), (".jpg", ".png")).name
        'photo_bokeh_2.png'
    """
    extension = picture.suffix if picture.suffix.lower() in extensions else _FALLBACK
    path = picture.with_name(f"{picture.stem}_bokeh{extension}")
    number = 1
    while path.exists() or path.is_symlink():
        number += 1
        path = picture.with_name(f"{picture.stem}_bokeh_{number}{extension}")
    return path

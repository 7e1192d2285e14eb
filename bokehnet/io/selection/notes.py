"""Notes on the selection of a picture: among views of a stereo pair or view layers, cropped data window."""

import struct

from bokehnet.io.exr.header import Attribute
from bokehnet.io.pixels import ImageFile
from bokehnet.io.selection.picture import Picture, picture_layers
from bokehnet.io.window import Window

__all__ = ["selection_notes"]


def selection_notes(file: ImageFile, picture: Picture) -> tuple[str, ...]:
    """Return one line for each selection among several pictures, and for a crop; empty for most files.

    Args:
        file: Open file.
        picture: Selected picture of the file.
    """
    if file.headers is None:
        return ()
    notes = []
    views = _views(file)
    if len(views) > 1:
        own = file.headers.parts[picture.part.index].get("view")
        selected = views[0] if own is None else str(own.value())
        notes.append(f"of the views {', '.join(views)} only {selected} is rendered")
    layers = [layer for layer in picture_layers(picture.part) if not _is_view(layer, views)]
    selected = picture.colours[0].rpartition(".")[0]
    if len(layers) > 1 and selected in layers:
        notes.append(f"of the layers {', '.join(layers)} only {selected} is rendered")
    return (*notes, *_window_notes(picture.part.window))


def _window_notes(window: Window) -> tuple[str, ...]:
    """Return a note on a picture that is stored in part."""
    is_whole = (
        window.x <= 0
        and window.y <= 0
        and window.x + window.width >= window.display_width
        and window.y + window.height >= window.display_height
    )
    if is_whole:
        return ()
    return (
        f"only {window.width}x{window.height} pixels at x={window.x}, y={window.y} of "
        f"{window.display_width}x{window.display_height} are stored; the picture is continued around them, "
        "not black",
    )


def _is_view(layer: str, views: list[str]) -> bool:
    return bool({word for word in layer.split(".") if word} & set(views[1:]))


def _views(file: ImageFile) -> list[str]:
    """Return the views of a file, the default one first."""
    assert file.headers is not None
    views: list[str] = []
    for part in file.headers.parts:
        if "view" in part:
            views.append(str(part["view"].value()))
        elif "multiView" in part:
            views += _string_vector(part["multiView"])
    return list(dict.fromkeys(views))


def _string_vector(attribute: Attribute) -> list[str]:
    """Return the strings of a ``stringvector``, up to the first damaged one."""
    texts, data = [], attribute.data
    while len(data) >= 4:
        (length,) = struct.unpack("<i", data[:4])
        if not 0 < length <= len(data) - 4:
            break
        texts.append(data[4 : 4 + length].decode("utf-8", "replace"))
        data = data[4 + length :]
    return texts

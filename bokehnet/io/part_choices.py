"""What was chosen where a file holds several pictures, in words: views of a stereo pair, view layers."""

import struct

from bokehnet.io.exr.header import Attribute
from bokehnet.io.picture import Picture, picture_layers
from bokehnet.io.pixels import ImageFile

__all__ = ["choices"]


def choices(file: ImageFile, picture: Picture) -> tuple[str, ...]:
    """Return a line for each choice among pictures that was made; most files leave none.

    Args:
        file: An open file.
        picture: What is taken of it.
    """
    if file.headers is None:
        return ()
    notes = []
    views = _views(file)
    if len(views) > 1:
        own = file.headers.parts[picture.part.index].get("view")
        taken = views[0] if own is None else str(own.value())
        notes.append(f"of the views {', '.join(views)} only {taken} is rendered")
    layers = [layer for layer in picture_layers(picture.part) if not _is_view(layer, views)]
    taken = picture.colours[0].rpartition(".")[0]
    if len(layers) > 1 and taken in layers:
        notes.append(f"of the layers {', '.join(layers)} only {taken} is rendered")
    return tuple(notes)


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
            views += _texts(part["multiView"])
    return list(dict.fromkeys(views))


def _texts(attribute: Attribute) -> list[str]:
    """Return the texts of a ``stringvector``; what is damaged ends it."""
    texts, data = [], attribute.data
    while len(data) >= 4:
        (length,) = struct.unpack("<i", data[:4])
        if not 0 < length <= len(data) - 4:
            break
        texts.append(data[4 : 4 + length].decode("utf-8", "replace"))
        data = data[4 + length :]
    return texts

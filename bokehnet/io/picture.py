"""Which channels of a file are the picture, and the light that they stand for."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError
from bokehnet.io.banded import in_bands
from bokehnet.io.color import srgb_to_linear
from bokehnet.io.pixels import ImageFile, Part

__all__ = ["Picture", "find_picture", "read_light", "read_light_and_alpha"]

_PICTURE_LAYERS = ("combined", "beauty", "rgba", "rgb")


@dataclass(frozen=True, kw_only=True)
class Picture:
    """The channels that make the picture: R, G, B or one grey channel, and alpha where there is one."""

    part: Part
    colours: tuple[str, ...]
    alpha: str | None


def find_picture(file: ImageFile) -> Picture:
    """Find the part and the channels that make the picture.

    Parts are searched in their order; one that is called beauty, combined, rgba or rgb comes first.

    Raises:
        ImageFileError: there are no colours, or several layers of them.
    """
    parts = sorted(file.parts, key=lambda part: _last_word(part.name) not in _PICTURE_LAYERS)
    for part in parts:
        names = part.channels
        layers = [name[:-1] for name in names if name.endswith("R") and _is_layer(name[:-1], names)]
        if "" in layers or len(layers) == 1:
            return _layer(part, "" if "" in layers else layers[0])
        for layer in layers:
            if _last_word(layer.rstrip(".")) in _PICTURE_LAYERS:
                return _layer(part, layer)
        if layers:
            found = ", ".join(layer.rstrip(".") for layer in layers)
            raise ImageFileError(
                f"{file.path}: expected one layer with R, G, B, found {found}; keep one of them"
            )
        grey = [name for name in names if name != part.alpha]
        if "Y" in grey:
            return Picture(part=part, colours=("Y",), alpha=part.alpha)
        if len(grey) == 1 and file.file_format != "openexr":
            return Picture(part=part, colours=tuple(grey), alpha=part.alpha)
    found = ", ".join(name for part in file.parts for name in part.channels)
    raise ImageFileError(f"{file.path}: expected channels R, G, B or Y, found {found}")


def read_light(file: ImageFile, picture: Picture) -> NDArray[np.float32]:
    """Read the picture over black as scene-linear light, (H, W, 3).

    Straight colours (PNG, WebP) are multiplied by alpha, premultiplied ones (EXR) are the light itself.

    Raises:
        ImageFileError: the pixels are damaged, NaN or infinite.
    """
    part = picture.part
    is_light = part.premultiplied and part.linear  # with or without alpha
    names = picture.colours if is_light or picture.alpha is None else (*picture.colours, picture.alpha)
    return _light(file, file.read(part, names), picture)


def read_light_and_alpha(
    file: ImageFile, picture: Picture
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Read the picture as :func:`read_light`, and its alpha (H, W): None if it has none or is 1 everywhere.

    Raises:
        ImageFileError: the pixels are damaged, NaN or infinite.
    """
    if picture.alpha is None:
        return read_light(file, picture), None
    values = file.read(picture.part, (*picture.colours, picture.alpha))
    image, alpha = _light(file, values, picture), values[..., -1:]
    _check_finite(file, alpha)
    return image, None if (alpha == 1).all() else np.ascontiguousarray(alpha[..., 0])


def _layer(part: Part, layer: str) -> Picture:
    """Return the picture under the prefix ``layer``, with its own alpha."""
    alpha = layer + "A" if layer + "A" in part.channels else None
    return Picture(part=part, colours=tuple(layer + colour for colour in "RGB"), alpha=alpha)


def _last_word(name: str) -> str:
    return name.rpartition(".")[2].lower()


def _is_layer(prefix: str, names: tuple[str, ...]) -> bool:
    return (not prefix or prefix.endswith(".")) and all(prefix + colour in names for colour in "GB")


def _light(file: ImageFile, values: NDArray[np.float32], picture: Picture) -> NDArray[np.float32]:
    """Turn the stored colours, and the alpha that may follow them, into light."""
    part, colours = picture.part, len(picture.colours)
    colour, alpha = values[..., :colours], values[..., colours:]
    if part.linear:
        image = colour if part.premultiplied or not alpha.shape[-1] else colour * alpha
    elif not alpha.shape[-1]:
        image = in_bands(srgb_to_linear, colour)
    else:
        if part.premultiplied:  # in encoded values: undo, decode, multiply again
            colour = np.divide(colour, np.where(alpha > 0, alpha, 1), dtype=np.float32)
        image = in_bands(srgb_to_linear, colour) * alpha
    _check_finite(file, image)
    return np.ascontiguousarray(np.broadcast_to(image, (*image.shape[:2], 3)), dtype=np.float32)


def _check_finite(file: ImageFile, values: NDArray[np.float32]) -> None:
    bad = sum(int((~np.isfinite(row)).any(axis=-1).sum()) for row in values)
    if bad:
        raise ImageFileError(
            f"{file.path}: {bad} pixels are NaN or infinite; replace them by finite values first"
        )

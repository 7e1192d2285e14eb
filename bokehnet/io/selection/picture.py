"""Select the picture channels of a file and decode them to linear light."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.arrays.row_blocks import in_row_blocks
from bokehnet.errors import ImageFileError
from bokehnet.io.color.color_space import ColorSpace
from bokehnet.io.color.transfer import Curve
from bokehnet.io.pixels import ImageFile, Part, as_stored

__all__ = ["Picture", "find_picture", "picture_layers", "read_light", "read_light_and_alpha"]

_PICTURE_LAYERS = ("combined", "beauty", "rgba", "rgb")


@dataclass(frozen=True, kw_only=True)
class Picture:
    """The channels of the picture: R, G, B or one grey channel, and alpha if present."""

    part: Part
    colours: tuple[str, ...]
    alpha: str | None


def find_picture(file: ImageFile) -> Picture:
    """Return the part and the channels of the picture.

    Parts are searched in file order; one named beauty, combined, rgba or rgb comes first, a deep one last.

    Raises:
        ImageFileError: There are no colours, or several layers of them.
    """
    parts = sorted(file.parts, key=lambda part: (_last_word(part.name) not in _PICTURE_LAYERS, part.deep))
    for part in parts:
        names = part.channels
        layers = [name[:-1] for name in names if name.endswith("R") and _is_layer(name[:-1], names)]
        if "" in layers or len(layers) == 1:
            return _layer(part, "" if "" in layers else layers[0])
        for layer in layers:
            if _last_word(layer.rstrip(".")) in _PICTURE_LAYERS:
                return _layer(part, layer)
        if layers:
            layer_names = ", ".join(layer.rstrip(".") for layer in layers)
            raise ImageFileError(
                f"{file.path}: expected one layer with R, G, B, found {layer_names}; keep one of them"
            )
        grey = [name for name in names if name != part.alpha]
        if {"Y", "RY", "BY"} <= set(grey):
            raise ImageFileError(
                f"{file.path}: expected channels R, G, B, found luminance and chroma, Y, RY, BY; "
                "write R, G, B instead"
            )
        if "Y" in grey:
            return Picture(part=part, colours=("Y",), alpha=part.alpha)
        if len(grey) == 1 and file.file_format != "openexr":
            return Picture(part=part, colours=tuple(grey), alpha=part.alpha)
    channels = ", ".join(name for part in file.parts for name in part.channels)
    raise ImageFileError(f"{file.path}: expected channels R, G, B or Y, found {channels}")


def picture_layers(part: Part) -> list[str]:
    """Return the layers of a part whose names mark a complete picture, such as ``View Layer.Combined``."""
    names = part.channels
    layers = [name[:-1] for name in names if name.endswith("R") and _is_layer(name[:-1], names)]
    return [layer.rstrip(".") for layer in layers if _last_word(layer.rstrip(".")) in _PICTURE_LAYERS]


def read_light(file: ImageFile, picture: Picture, space: ColorSpace) -> NDArray[np.float32]:
    """Read the picture over black as linear light in its own primaries, (H, W, 3).

    Straight colours (PNG, WebP) are multiplied by alpha, premultiplied ones (EXR) are the light itself.

    Args:
        file: Open file.
        picture: Picture of that file.
        space: Colour space of its values.

    Raises:
        ImageFileError: The pixels are damaged, NaN or infinite.
    """
    is_light = picture.part.premultiplied and space.is_linear  # with or without alpha
    return _read(file, picture, space, with_alpha=picture.alpha is not None and not is_light)[0]


def read_light_and_alpha(
    file: ImageFile, picture: Picture, space: ColorSpace
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Read the picture as :func:`read_light`, and its alpha (H, W); None if absent or 1 everywhere.

    Raises:
        ImageFileError: The pixels are damaged, NaN or infinite.
    """
    image, alpha = _read(file, picture, space, with_alpha=picture.alpha is not None)
    return image, None if alpha is None or (alpha == 1).all() else alpha


def _read(
    file: ImageFile, picture: Picture, space: ColorSpace, with_alpha: bool
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Read the picture band by band, so that only light and alpha are ever held entirely in memory."""
    part, colours = picture.part, len(picture.colours)
    names = (*picture.colours, str(picture.alpha)) if with_alpha else picture.colours
    image = file.empty(part, 3)
    alpha = file.empty(part, 1) if with_alpha else None
    light_rows = as_stored(image, part.orientation)
    kind = part.formats[part.channels.index(names[0])]
    by_lookup = kind in _LEVELS and not space.is_linear and not with_alpha and len(set(part.formats)) == 1
    bad, first_bad = 0, ""
    for rows, values in file.read_bands(part, names, kind if by_lookup else "float"):
        if by_lookup:
            light_rows[rows] = _decode_integers(values, space, kind)
            continue
        light = _light(values[..., :colours], values[..., colours:], part, space)
        faulty = ~np.isfinite(light).all(axis=-1) | ~np.isfinite(values).all(axis=-1)
        if not bad and faulty.any():
            row, column = (int(index) for index in np.argwhere(faulty)[0])
            first_bad = f"row {rows.start + row}, column {column}"
        bad += int(faulty.sum())
        light_rows[rows] = light
        if alpha is not None:
            as_stored(alpha, part.orientation)[rows] = values[..., colours:]
    if bad:
        raise ImageFileError(
            f"{file.path}: {bad} pixels are NaN or infinite, first as stored at {first_bad}; replace them by "
            "finite values first"
        )
    return image, None if alpha is None else alpha[..., 0]


def _layer(part: Part, layer: str) -> Picture:
    """Return the picture under the prefix ``layer``, with its own alpha."""
    alpha = layer + "A" if layer + "A" in part.channels else None
    return Picture(part=part, colours=tuple(layer + colour for colour in "RGB"), alpha=alpha)


def _last_word(name: str) -> str:
    return name.rpartition(".")[2].lower()


def _is_layer(prefix: str, names: tuple[str, ...]) -> bool:
    return (not prefix or prefix.endswith(".")) and all(prefix + colour in names for colour in "GB")


def _light(
    colour: NDArray[np.float32], alpha: NDArray[np.float32], part: Part, space: ColorSpace
) -> NDArray[np.float32]:
    """Convert stored colours (rows, W, 1 or 3), and alpha (rows, W, 0 or 1), to light."""
    if space.is_linear:
        return colour if part.premultiplied or not alpha.shape[-1] else colour * alpha
    if not alpha.shape[-1]:
        return in_row_blocks(space.decode, colour)
    if part.premultiplied:  # premultiplied in encoded values: divide, decode, multiply again
        colour = np.divide(colour, np.where(alpha > 0, alpha, 1), dtype=np.float32)
    light: NDArray[np.float32] = in_row_blocks(space.decode, colour) * alpha
    return light


def _decode_integers(values: NDArray[Any], space: ColorSpace, kind: str) -> NDArray[np.float32]:
    """Convert stored integers (rows, W, 1 or 3) to light."""
    if len(set(space.curves)) == 1 or values.shape[-1] == 1:
        return _decoding_table(space.curves[0], kind).take(values)
    planes = [_decoding_table(curve, kind).take(values[..., i]) for i, curve in enumerate(space.curves)]
    return np.stack(planes, axis=-1)


_LEVELS = {"uint8": 2**8, "uint16": 2**16}


@lru_cache(maxsize=12)
def _decoding_table(curve: Curve, kind: str) -> NDArray[np.float32]:
    """Return the light of every value of an integer type."""
    count = _LEVELS[kind]
    return np.asarray(curve.decode(np.arange(count, dtype=np.float32) / np.float32(count - 1)))

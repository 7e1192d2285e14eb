"""Pictures: files to scene-linear arrays and back."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.checks import check_image, check_map
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.atomic import check_target
from bokehnet.io.color import linear_to_srgb, srgb_to_linear
from bokehnet.io.encode import encode
from bokehnet.io.pixels import ImageFile, Part

__all__ = [
    "IMAGE_EXTENSIONS",
    "MAP_EXTENSIONS",
    "check_writable",
    "read_image",
    "write_image",
    "write_map",
]

IMAGE_EXTENSIONS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".exr", ".hdr")
MAP_EXTENSIONS = (".png", ".exr")

_LARGEST_HALF = 65504.0
_PICTURE_LAYERS = ("combined", "beauty", "rgba", "rgb")


def read_image(path: Path | str) -> NDArray[np.float32]:
    """Read a picture as scene-linear light, Rec.709 primaries; 1 is white, values above 1 are kept.

    Integer files (JPEG, PNG, TIFF, WebP) are decoded from sRGB, embedded colour profiles are not applied;
    EXR, HDR and floating-point TIFF are linear already. EXIF orientation is applied. Grey becomes three
    equal channels. EXR gives its channels R, G, B, bare or under a layer name, else Y; others are ignored.

    Alpha is dropped by laying the picture over black, in linear light: straight colours (PNG, WebP) are
    multiplied by alpha, premultiplied ones (EXR) are the light itself and stay as they are.

    Args:
        path: JPEG, PNG (8 or 16 bit), TIFF, WebP, EXR or HDR file.

    Returns:
        Image of shape (H, W, 3).

    Raises:
        ImageFileError: the file cannot be read, has no colours, or holds NaN or infinity.
    """
    with ImageFile(path) as file:
        part, names = _find_colours(file)
        straight_or_encoded = not (part.premultiplied and part.linear)
        alpha = part.alpha if straight_or_encoded else None
        values = file.read(part, [*names, alpha] if alpha else names)
    image = _over_black(values, len(names), part)
    bad = int((~np.isfinite(image)).any(axis=-1).sum())
    if bad:
        raise ImageFileError(f"{path}: {bad} pixels are NaN or infinite; replace them by finite values first")
    return np.ascontiguousarray(np.broadcast_to(image, (*image.shape[:2], 3)), dtype=np.float32)


def write_image(path: Path | str, image: NDArray[Any], *, quality: int = 95, bits: int = 8) -> None:
    """Write a scene-linear picture atomically; the extension picks the format.

    ``.png``, ``.jpg``, ``.tif`` and ``.webp`` are sRGB, clipped to [0, 1] and rounded. ``.exr`` is linear
    half with ZIP compression, clipped to +-65504. ``.hdr`` is linear, negative values become 0.

    Args:
        path: where the picture goes; one of ``IMAGE_EXTENSIONS``.
        image: scene-linear Rec.709, (H, W, 3), finite.
        quality: of JPEG and WebP, 1 to 100.
        bits: per channel of PNG and TIFF, 8 or 16.

    Raises:
        ImageFileError: unknown extension, or the file cannot be written.
        ShapeError, ParameterError: the array or an option is not as described.
    """
    path = Path(path)
    check_writable(path)
    check_image("image", image)
    if not 1 <= quality <= 100:
        raise ParameterError(f"quality: expected 1 to 100, got {quality}")
    extension = path.suffix.lower()
    if bits not in (8, 16) or (bits == 16 and extension not in (".png", ".tif", ".tiff")):
        raise ParameterError(f"bits: expected 8, or 16 for .png and .tif, got {bits} for {extension}")
    if extension == ".exr":
        half = np.clip(image, -_LARGEST_HALF, _LARGEST_HALF).astype(np.float16)
        encode(path, half, ("R", "G", "B"), {"compression": "zip"})
    elif extension == ".hdr":
        encode(path, np.maximum(image, 0).astype(np.float32), ("R", "G", "B"), {})
    else:
        codec = {".jpg": "jpeg", ".jpeg": "jpeg", ".webp": "webp"}.get(extension)
        hints = {"compression": f"{codec}:{quality}"} if codec else {}
        if codec == "jpeg":
            hints["jpeg:subsampling"] = "4:4:4"  # halved colour resolution shows at small bright discs
        srgb = linear_to_srgb(np.clip(image, 0, 1))
        encode(path, _quantise(srgb, bits), ("R", "G", "B"), hints)


def write_map(path: Path | str, values: NDArray[Any], *, channel: str = "Y") -> None:
    """Write a single-channel map, such as a defocus or an error map, without any transfer function.

    ``.png`` has 8 bits: values are clipped to [0, 1] and rounded. ``.exr`` keeps float32 values.

    Args:
        path: where the map goes; one of ``MAP_EXTENSIONS``.
        values: (H, W), finite.
        channel: name of the channel in an EXR file.

    Raises:
        ImageFileError: unknown extension, or the file cannot be written.
        ShapeError, ParameterError: the array is not as described.
    """
    path = Path(path)
    check_writable(path, MAP_EXTENSIONS)
    check_map("map", values)
    if path.suffix.lower() == ".exr":
        encode(path, values[..., None].astype(np.float32), (channel,), {"compression": "zip"})
    else:
        encode(path, _quantise(np.clip(values, 0, 1), 8)[..., None], ("Y",), {})


def check_writable(path: Path | str, extensions: tuple[str, ...] = IMAGE_EXTENSIONS) -> None:
    """Raise unless a picture could be written at ``path``; call it before any long work.

    Args:
        path: where a picture shall go.
        extensions: the known ones, lower case.

    Raises:
        ImageFileError: unknown extension, folder missing or not writable, or ``path`` is a folder.
    """
    path = Path(path)
    check_target(path)
    if path.suffix.lower() not in extensions:
        known = ", ".join(extensions)
        raise ImageFileError(f"{path}: unknown extension {path.suffix!r}, expected one of {known}")


def _find_colours(file: ImageFile) -> tuple[Part, list[str]]:
    """Find the part and the channels that make the picture: R, G, B, or one grey channel."""
    for part in file.parts:
        names = part.channels
        layers = [name[:-1] for name in names if name.endswith("R") and _is_layer(name[:-1], names)]
        if "" in layers or len(layers) == 1:
            layer = "" if "" in layers else layers[0]
            return part, [layer + colour for colour in "RGB"]
        for layer in layers:
            if layer.rstrip(".").rpartition(".")[2].lower() in _PICTURE_LAYERS:
                return part, [layer + colour for colour in "RGB"]
        if layers:
            found = ", ".join(layer.rstrip(".") for layer in layers)
            raise ImageFileError(
                f"{file.path}: expected one layer with R, G, B, found {found}; keep one of them"
            )
        grey = [name for name in names if name != part.alpha]
        if "Y" in grey:
            return part, ["Y"]
        if len(grey) == 1 and file.file_format != "openexr":
            return part, grey
    found = ", ".join(name for part in file.parts for name in part.channels)
    raise ImageFileError(f"{file.path}: expected channels R, G, B or Y, found {found}")


def _is_layer(prefix: str, names: tuple[str, ...]) -> bool:
    return (not prefix or prefix.endswith(".")) and all(prefix + colour in names for colour in "GB")


def _over_black(values: NDArray[np.float32], colours: int, part: Part) -> NDArray[np.float32]:
    """Decode stored values and drop the alpha that may follow the ``colours`` first channels."""
    colour, alpha = values[..., :colours], values[..., colours:]
    if not alpha.shape[-1]:
        return colour if part.linear else srgb_to_linear(colour)
    if part.linear:
        return colour * alpha
    if part.premultiplied:  # in encoded values: undo, decode, multiply again
        colour = np.asarray(colour / np.where(alpha > 0, alpha, 1), dtype=np.float32)
    return np.asarray(srgb_to_linear(colour) * alpha)


def _quantise(values: NDArray[Any], bits: int) -> NDArray[Any]:
    """Round values in [0, 1] to unsigned integers."""
    scaled = np.asarray(values, dtype=np.float64) * (2**bits - 1)
    return np.rint(scaled).astype(np.uint8 if bits == 8 else np.uint16)

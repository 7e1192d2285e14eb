"""Write AVIF and HEIC, whose encoders need the entire picture at once: extras ``avif`` and ``heif``."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.checks import require_extra
from bokehnet.errors import ImageFileError, MissingExtraError
from bokehnet.io.files.atomic import write_atomic
from bokehnet.io.metadata.photo_metadata import Metadata
from bokehnet.progress import Progress

__all__ = ["WHOLE_EXTENSIONS", "Coding", "check_encoder", "encode_whole"]

# Name of the format, and the extra that provides its encoder.
_FORMATS = {".avif": ("AVIF", "avif"), ".heic": ("HEIC", "heif"), ".heif": ("HEIF", "heif")}
WHOLE_EXTENSIONS = tuple(_FORMATS)

# Code points of sRGB with the matrix of BT.601: ITU-T H.273, tables 2 to 4.
_SRGB_CODE = {"color_primaries": 1, "transfer_characteristic": 13, "matrix_coefficients": 6}

# Exceptions of the encoders and decoders.
_FAILURES = (OSError, ValueError, RuntimeError, SyntaxError, EOFError)


@dataclass(frozen=True, kw_only=True)
class Coding:
    """Coding parameters of the pixels.

    Attributes:
        bits: 8, or 10 for HEIC.
        quality: 1 to 100.
        subsampling: Chroma subsampling: 4:4:4, 4:2:2 or 4:2:0.
        icc: Colour profile; None for sRGB.
    """

    bits: int
    quality: int
    subsampling: str
    icc: bytes | None


def check_encoder(path: Path) -> None:
    """Raise unless the encoder for the extension of ``path`` is installed.

    Raises:
        ImageFileError: The installed library was built without the encoder.
        MissingExtraError: The library is not installed.
    """
    extension = path.suffix.lower()
    name, extra = _FORMATS[extension]
    module = "PIL" if extension == ".avif" else "pillow_heif"
    try:
        require_extra(module, extra)
    except MissingExtraError as error:
        raise MissingExtraError(
            f"{path}: to write {name} {error}, or write .jxl, .jpg or .png"
        ) from error.__cause__
    if not (_writes_avif() if extension == ".avif" else _writes_heic()):
        raise ImageFileError(
            f"{path}: the installed {module} has no encoder for {name}; pip install -U 'bokehnet[{extra}]', "
            "or write .jxl, .jpg or .png"
        )


def _writes_avif() -> bool:
    from PIL import features

    return "avif" in features.modules and bool(features.check("avif"))


def _writes_heic() -> bool:
    import pillow_heif

    return bool(pillow_heif.libheif_info()["HEIF"])


def encode_whole(
    path: Path,
    shape: tuple[int, int, int],
    stored: Callable[[slice], NDArray[Any]],
    coding: Coding,
    metadata: Metadata,
    progress: Progress | None = None,
) -> None:
    """Encode a picture, check that it can be read back, and put it in place atomically.

    Args:
        path: File to write; the extension selects the format.
        shape: (H, W, C), with three colours and optionally alpha.
        stored: Function from rows to integers of ``coding.bits``; called by several threads.
        coding: Coding parameters of the pixels.
        metadata: EXIF and XMP, refreshed for this picture.
        progress: Progress callback, called when the pixels are computed and when they are encoded.

    Raises:
        ImageFileError: The file cannot be written.
    """
    dtype = np.uint8 if coding.bits == 8 else np.uint16
    values = make_in_row_blocks(stored, shape, dtype)
    if progress is not None:
        progress(1, 2)
    embedded = {"exif": metadata.exif, "xmp": metadata.xmp, "icc_profile": coding.icc}
    options = {"quality": coding.quality} | {name: data for name, data in embedded.items() if data}
    encode = _avif if path.suffix.lower() == ".avif" else _heic

    def fill(temporary: Path) -> None:
        try:
            data = encode(values, coding, options)
        except _FAILURES as error:
            raise OSError(" ".join(str(error).split())) from error
        temporary.write_bytes(data)

    write_atomic(path, fill)
    if progress is not None:
        progress(2, 2)


def _avif(values: NDArray[Any], coding: Coding, options: dict[str, Any]) -> bytes:
    from PIL import Image

    file = io.BytesIO()
    picture = Image.fromarray(values)
    picture.save(file, "AVIF", subsampling=coding.subsampling, **options)
    file.seek(0)
    Image.open(file).load()
    return file.getvalue()


def _heic(values: NDArray[Any], coding: Coding, options: dict[str, Any]) -> bytes:
    import pillow_heif

    height, width, channels = values.shape
    mode = {3: "RGB", 4: "RGBA"}[channels]
    if coding.bits > 8:
        mode, values = f"{mode};16", values << (16 - coding.bits)  # left-aligned in 16 bits
    file = io.BytesIO()
    pillow_heif.encode(
        mode,
        (width, height),
        values.tobytes(),
        file,
        chroma=coding.subsampling.replace(":", ""),
        **_SRGB_CODE,
        **options,
    )
    np.asarray(pillow_heif.open_heif(io.BytesIO(file.getvalue()), convert_hdr_to_8bit=False))
    return file.getvalue()

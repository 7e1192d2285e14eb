"""Valid files that few programs write, of random contents: not a test itself.

Each maker gets a folder and a random generator and writes one file; what it returns is the file.
"""

import struct
import zlib

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from PIL import Image

from tests.unit.io.exr import exr_by_hand
from tests.unit.io.exr.exr_files import deep_samples, write_deep, write_exr

COMPRESSIONS = ("none", "rle", "zip", "zips", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab")


def _size(rng, least=1, most=70):
    return int(rng.integers(least, most)), int(rng.integers(least, most))


def _bytes(rng, height, width, channels):
    """A picture with smooth and rough parts."""
    picture = rng.integers(0, 256, (height, width, channels))
    picture[: height // 2] = np.arange(width)[:, None] * 3 % 256
    return picture.astype(np.uint8)


def _layers(rng, names, height, width, kind="half"):
    return {name: (kind, rng.random((height, width)).astype(np.float32)) for name in names}


def exr_multi_part(folder, rng):
    height, width = _size(rng)
    parts = [{"channels": _layers(rng, names, height, width)} for names in ("RGBA", "Z", "XYZ")]
    return write_exr(folder / "a.exr", *parts[: int(rng.integers(1, 4))])


def exr_deep(folder, rng):
    height, width = _size(rng, most=24)
    pixels = deep_samples(int(rng.integers(2**31)), height, width, 6, bool(rng.integers(2)))
    tile = int(rng.choice([0, 0, 5, 8, 16]))
    packing = str(rng.choice(["none", "rle", "zips"]))
    return write_deep(folder / "a.exr", pixels, tile=tile, compression=packing, x=int(rng.integers(-9, 9)))


def exr_tiled(folder, rng):
    height, width = _size(rng)
    side = int(rng.choice([3, 8, 16, 64]))
    return write_exr(
        folder / "a.exr",
        {
            "channels": _layers(rng, "RGBAZ", height, width),
            "tile_width": side,
            "tile_height": side,
            "attributes": {"compression": str(rng.choice(COMPRESSIONS))},
        },
    )


def exr_compressed(folder, rng):
    height, width = _size(rng)
    return write_exr(
        folder / "a.exr",
        {
            "channels": _layers(rng, "RGBZ", height, width, str(rng.choice(["half", "float"]))),
            "attributes": {"compression": str(rng.choice(COMPRESSIONS))},
        },
    )


def exr_levels(folder, rng):
    height, width = _size(rng)
    mode = int(rng.choice([exr_by_hand.ONE, exr_by_hand.MIP, exr_by_hand.RIP]))
    arrays = _layers(rng, "RGBZ", height, width)
    (folder / "a.exr").write_bytes(exr_by_hand.tiles(arrays, int(rng.choice([4, 16, 32])), mode))
    return folder / "a.exr"


def exr_cropped(folder, rng):
    height, width = _size(rng)
    x, y = (int(value) for value in rng.integers(-40, 40, 2))
    x_shown, y_shown = (int(value) for value in rng.integers(-20, 20, 2))
    shown = (x_shown, y_shown, x_shown + int(rng.integers(1, 60)), y_shown + int(rng.integers(1, 60)))
    window = (x, y, x + width - 1, y + height - 1)
    arrays = _layers(rng, "RGBZ", height, width)
    (folder / "a.exr").write_bytes(exr_by_hand.scan_lines(arrays, window=window, display=shown))
    return folder / "a.exr"


def exr_luminance_chroma(folder, rng):
    height, width = (2 * size for size in _size(rng, most=30))
    arrays = _layers(rng, ("Y", "RY", "BY"), height, width)
    (folder / "a.exr").write_bytes(exr_by_hand.scan_lines(arrays, {"RY": (2, 2), "BY": (2, 2)}))
    return folder / "a.exr"


def exr_sub_sampled(folder, rng):
    across, down = (int(value) for value in rng.integers(1, 5, 2))
    height, width = down * int(rng.integers(1, 20)), across * int(rng.integers(1, 20))
    name = str(rng.choice(list("RGZ")))
    arrays = _layers(rng, "RGBZ", height, width, str(rng.choice(["half", "float"])))
    (folder / "a.exr").write_bytes(exr_by_hand.scan_lines(arrays, {name: (across, down)}))
    return folder / "a.exr"


def exr_whole_numbers(folder, rng):
    height, width = _size(rng)
    numbers = {name: ("uint", rng.integers(0, 2**31, (height, width))) for name in ("id", "R", "Z")}
    arrays = _layers(rng, "RGBZ", height, width) | dict(list(numbers.items())[: int(rng.integers(1, 4))])
    (folder / "a.exr").write_bytes(exr_by_hand.scan_lines(arrays))
    return folder / "a.exr"


def png_interlaced(folder, rng):
    """Adam7, by hand after ISO/IEC 15948, of 1, 2, 4 or 8 bits, grey or by palette."""
    height, width = _size(rng, most=30)
    bits, palette = int(rng.choice([1, 2, 4, 8])), bool(rng.integers(2))
    values = rng.integers(0, 2**bits, (height, width))
    passes = [
        (0, 0, 8, 8),
        (0, 4, 8, 8),
        (4, 0, 8, 4),
        (0, 2, 4, 4),
        (2, 0, 4, 2),
        (0, 1, 2, 2),
        (1, 0, 2, 1),
    ]
    rows = b""
    for top, left, down, across in passes if rng.integers(4) else [(0, 0, 1, 1)]:
        part = values[top::down, left::across]
        for row in part if part.shape[1] else []:
            spread = (row[:, None] >> np.arange(bits)[::-1]) & 1
            rows += b"\0" + np.packbits(spread.astype(np.uint8).ravel()).tobytes()
        interlaced = int(down != 1)
    chunks = [(b"IHDR", struct.pack(">2I5B", width, height, bits, 3 if palette else 0, 0, 0, interlaced))]
    if palette:
        chunks.append((b"PLTE", rng.integers(0, 256, 3 * 2**bits).astype(np.uint8).tobytes()))
        if rng.integers(2):
            chunks.append((b"tRNS", rng.integers(0, 256, 2**bits).astype(np.uint8).tobytes()))
    chunks += [(b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    body = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
    (folder / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    return folder / "a.png"


def _pillow(folder, rng, extension, modes, **options):
    height, width = _size(rng)
    mode = str(rng.choice(modes))
    picture = Image.fromarray(_bytes(rng, height, width, 4), "RGBA")
    if mode == "CMYK":
        picture = Image.fromarray(_bytes(rng, height, width, 4), "CMYK")
    elif mode in ("I;16", "F"):
        kind = np.uint16 if mode == "I;16" else np.float32
        picture = Image.fromarray((rng.random((height, width)) * 60000).astype(kind))
    else:
        picture = picture.convert("RGB").convert(mode) if mode in ("P", "1") else picture.convert(mode)
    path = folder / f"a.{extension}"
    if rng.integers(2) and "exif" not in options and extension in ("jpg", "png", "webp", "tif"):
        exif = Image.Exif()
        exif[0x0112] = int(rng.integers(1, 9))
        options["exif"] = exif
    picture.save(path, **options)
    return path


def png_of_all_kinds(folder, rng):
    return _pillow(folder, rng, "png", ["1", "L", "LA", "P", "RGB", "RGBA", "I;16"])


def _animated(folder, rng, extension):
    height, width = _size(rng)
    frames = [Image.fromarray(_bytes(rng, height, width, 3)) for _ in range(3)]
    frames[0].save(folder / f"a.{extension}", save_all=True, append_images=frames[1:])
    return folder / f"a.{extension}"


def png_animated(folder, rng):
    return _animated(folder, rng, "png")


def jpeg_of_all_kinds(folder, rng):
    options = {"progressive": bool(rng.integers(2)), "quality": int(rng.integers(1, 100))}
    return _pillow(folder, rng, "jpg", ["L", "RGB", "CMYK"], subsampling=int(rng.integers(3)), **options)


def tiff_of_all_kinds(folder, rng):
    modes = ["1", "L", "LA", "P", "RGB", "RGBA", "CMYK", "I;16", "F"]
    packing = str(rng.choice(["raw", "tiff_lzw", "tiff_adobe_deflate", "packbits"]))
    return _pillow(folder, rng, "tif", modes, compression=packing)


def tiff_of_other_kinds(folder, rng):
    """Tiles, planes one after the other, several pages, channels beyond colour."""
    height, width = _size(rng, least=16)
    kind = str(rng.choice(["uint8", "uint16", "half", "float", "double", "uint32", "int8", "int16"]))
    spec = oiio.ImageSpec(width, height, int(rng.integers(1, 7)), kind)
    spec.tile_width = spec.tile_height = int(rng.choice([0, 16, 32]))
    spec.attribute("planarconfig", str(rng.choice(["contig", "separate"])))
    spec.attribute("compression", str(rng.choice(["none", "lzw", "zip", "packbits"])))
    output = oiio.ImageOutput.create(str(folder / "a.tif"))
    assert output.open(str(folder / "a.tif"), spec), output.geterror()
    for page in range(int(rng.integers(1, 3))):
        assert not page or output.open(str(folder / "a.tif"), spec, "AppendSubimage"), output.geterror()
        assert output.write_image(rng.random((height, width, spec.nchannels)).astype(np.float32))
    assert output.close()
    return folder / "a.tif"


def webp_of_all_kinds(folder, rng):
    return _pillow(folder, rng, "webp", ["RGB", "RGBA"], lossless=bool(rng.integers(2)))


def webp_animated(folder, rng):
    return _animated(folder, rng, "webp")


def hdr(folder, rng):
    height, width = _size(rng)
    path, spec = str(folder / "a.hdr"), oiio.ImageSpec(width, height, 3, "float")
    output = oiio.ImageOutput.create(path)
    assert output.open(path, spec), output.geterror()
    assert output.write_image(rng.random((height, width, 3)).astype(np.float32))
    assert output.close()
    return folder / "a.hdr"


def widest(folder, rng):
    extension = str(rng.choice(["exr", "png", "tif", "jpg"]))
    width = 65500 if extension == "jpg" else 65535
    path, spec = str(folder / f"a.{extension}"), oiio.ImageSpec(width, int(rng.integers(1, 4)), 3, "uint8")
    output = oiio.ImageOutput.create(path)
    assert output.open(path, spec), output.geterror()
    assert output.write_image(rng.random((spec.height, width, 3)).astype(np.float32))
    assert output.close()
    return folder / f"a.{extension}"


def of_another_format(folder, rng):
    """Formats that are no pictures here, under a name that is."""
    inner = str(rng.choice(["gif", "bmp", "tga", "ppm", "dds", "ico", "sgi", "pcx", "jp2"]))
    picture = Image.fromarray(_bytes(rng, 24, 32, 3))
    picture.save(folder / f"inner.{inner}")
    path = folder / f"a.{rng.choice(['exr', 'png', 'jpg', 'tif', inner])}"
    return (folder / f"inner.{inner}").rename(path)


MAKERS = (
    exr_multi_part, exr_deep, exr_tiled, exr_compressed, exr_levels, exr_cropped, exr_luminance_chroma,
    exr_sub_sampled, exr_whole_numbers, png_interlaced, png_of_all_kinds, png_animated, jpeg_of_all_kinds,
    tiff_of_all_kinds, tiff_of_other_kinds, webp_of_all_kinds, webp_animated, hdr, widest, of_another_format,
)  # fmt: skip

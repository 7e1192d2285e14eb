import struct
import zlib

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest


@pytest.fixture
def store(tmp_path):
    """Write an array as it is, channels by name, without the code under test."""

    def write(name, array, channels=None, **attributes):
        path = str(tmp_path / name)
        array = array[..., None] if array.ndim == 2 else array
        kind = {"float16": "half", "float32": "float"}.get(array.dtype.name, array.dtype.name)
        spec = oiio.ImageSpec(array.shape[1], array.shape[0], array.shape[2], kind)
        if channels:
            spec.channelnames = tuple(channels)
            spec.alpha_channel = channels.index("A") if "A" in channels else -1
        for key, value in attributes.items():
            spec.attribute(key.replace("__", ":"), value)
        output = oiio.ImageOutput.create(path)
        assert output.open(path, spec), output.geterror()
        assert output.write_image(np.ascontiguousarray(array)), output.geterror()
        assert output.close()
        return tmp_path / name

    return write


@pytest.fixture
def store_parts(tmp_path):
    """Write a multi-part EXR: a list of (channel names, array)."""

    def write(name, parts):
        path = str(tmp_path / name)
        specs = []
        for index, (channels, array) in enumerate(parts):
            spec = oiio.ImageSpec(array.shape[1], array.shape[0], array.shape[2], "float")
            spec.channelnames = tuple(channels)
            spec.attribute("oiio:subimagename", f"part{index}")
            specs.append(spec)
        output = oiio.ImageOutput.create(path)
        assert output.open(path, tuple(specs)), output.geterror()
        for index, (_, array) in enumerate(parts):
            if index:
                assert output.open(path, specs[index], "AppendSubimage"), output.geterror()
            assert output.write_image(np.ascontiguousarray(array, dtype=np.float32)), output.geterror()
        assert output.close()
        return tmp_path / name

    return write


@pytest.fixture
def store_png(tmp_path):
    """Write an 8-bit PNG by hand after ISO/IEC 15948: width, colour type, rows of bytes, extra chunks."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    def write(name, width, colour_type, rows, extra=()):
        header = struct.pack(">IIBBBBB", width, len(rows), 8, colour_type, 0, 0, 0)
        pixels = zlib.compress(b"".join(b"\0" + bytes(row) for row in rows))
        chunks = [(b"IHDR", header), *extra, (b"IDAT", pixels), (b"IEND", b"")]
        body = b"".join(chunk(kind, data) for kind, data in chunks)
        (tmp_path / name).write_bytes(b"\x89PNG\r\n\x1a\n" + body)
        return tmp_path / name

    return write

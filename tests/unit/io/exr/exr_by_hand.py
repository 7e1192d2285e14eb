"""Uncompressed OpenEXR files written byte by byte, for what no library here writes: not a test itself.

Source: "OpenEXR File Layout", openexr.com.
"""

import struct

import numpy as np

TYPES = {"uint": (0, "<u4"), "half": (1, "<f2"), "float": (2, "<f4")}
ONE, MIP, RIP = 0, 1, 2


def _attribute(name, kind, data):
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data


def header(size, channels, *, window=None, display=None, tiles=None, extra=b"", compression=0):
    """Attributes of a part: ``channels`` {name: (type, x sampling, y sampling)}, ``tiles`` (size, mode)."""
    window = window or (0, 0, size[0] - 1, size[1] - 1)
    listed = b"".join(
        name.encode() + b"\0" + struct.pack("<iB3xii", TYPES[kind][0], 0, across, down)
        for name, (kind, across, down) in sorted(channels.items())
    )
    attributes = _attribute("channels", "chlist", listed + b"\0")
    attributes += _attribute("compression", "compression", bytes([compression]))
    attributes += _attribute("dataWindow", "box2i", struct.pack("<4i", *window))
    attributes += _attribute("displayWindow", "box2i", struct.pack("<4i", *(display or window)))
    attributes += _attribute("lineOrder", "lineOrder", b"\0")
    attributes += _attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    attributes += _attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0))
    attributes += _attribute("screenWindowWidth", "float", struct.pack("<f", 1))
    if tiles:
        attributes += _attribute("tiles", "tiledesc", struct.pack("<2IB", tiles[0], tiles[0], tiles[1]))
    return attributes + extra + b"\0"


def _file(flags, attributes, chunks):
    """Magic number, version, header, table of chunks, chunks."""
    start = struct.pack("<2I", 20000630, 2 | flags) + attributes
    at, offsets = len(start) + 8 * len(chunks), []
    for chunk in chunks:
        offsets.append(at)
        at += len(chunk)
    return start + struct.pack(f"<{len(offsets)}Q", *offsets) + b"".join(chunks)


def scan_lines(arrays, sampling=None, *, window=None, display=None):
    """The bytes of a file of scan lines; ``arrays`` {name: (type, (H, W) array)} at full size."""
    sampling = sampling or {}
    height, width = next(iter(arrays.values()))[1].shape
    channels = {name: (kind, *sampling.get(name, (1, 1))) for name, (kind, _) in arrays.items()}
    x, y = (window or (0, 0))[:2]
    chunks = []
    for row in range(height):
        line = b""
        for name, (kind, array) in sorted(arrays.items()):
            across, down = channels[name][1:]
            if (y + row) % down == 0:
                line += array[row, -x % across :: across].astype(TYPES[kind][1]).tobytes()
        chunks.append(struct.pack("<2i", y + row, len(line)) + line)
    return _file(0, header((width, height), channels, window=window, display=display), chunks)


def _levels(width, height, mode):
    """Yield number and size of every level, rounded down."""
    if mode == ONE:
        yield 0, 0, width, height
        return
    across, down = width.bit_length(), height.bit_length()
    if mode == MIP:
        for level in range(max(across, down)):
            yield level, level, max(width >> level, 1), max(height >> level, 1)
        return
    for row in range(down):
        for column in range(across):
            yield column, row, max(width >> column, 1), max(height >> row, 1)


def tiles(arrays, size, mode):
    """The bytes of a tiled file with all its levels; smaller ones are cut out of the largest."""
    height, width = next(iter(arrays.values()))[1].shape
    channels = {name: (kind, 1, 1) for name, (kind, _) in arrays.items()}
    chunks = []
    for across, down, columns, rows in _levels(width, height, mode):
        for top in range(0, rows, size):
            for left in range(0, columns, size):
                block = np.s_[top : min(top + size, rows), left : min(left + size, columns)]
                cut = [(TYPES[kind][1], array[block]) for _, (kind, array) in sorted(arrays.items())]
                data = b"".join(
                    array[row].astype(kind).tobytes()
                    for row in range(cut[0][1].shape[0])
                    for kind, array in cut
                )
                place = (left // size, top // size, across, down, len(data))
                chunks.append(struct.pack("<5i", *place) + data)
    return _file(0x200, header((width, height), channels, tiles=(size, mode)), chunks)

"""Feeds damaged files to the readers: ``python -m tests.unit.io.fuzz.fuzz_readers [seconds]``.

Valid files of every format are flipped, cut and filled at random places. Each reader must give a picture or
raise a :class:`BokehnetError` of one line, within seconds. It runs in a process of its own, because a
decoder that fails may take the process with it.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st
from PIL import Image

from bokehnet.io.frame import read_frame, write_frame
from bokehnet.io.image import write_image
from bokehnet.io.info import image_info
from bokehnet.io.maps import read_depth, read_disparity
from tests.unit.io.color import profiles
from tests.unit.io.fuzz.fuzz_unusual import clean
from tests.unit.io.metadata.test_photo_metadata import exif, packet

FILES_PER_FORMAT = 40
SECONDS_PER_FILE = 10
HEADER = 500  # where most decisions of a decoder are made


def valid_files(folder):
    """Write small files of all formats, and of all compressions of EXR."""
    rng = np.random.default_rng(0)
    image, alpha = rng.random((24, 32, 3)), rng.random((24, 32))
    for extension in ("png", "jpg", "tif", "webp", "exr", "hdr"):
        write_image(folder / f"plain.{extension}", image)
    for extension in ("png", "tif", "webp", "pfm"):
        write_image(folder / f"alpha.{extension}", image, alpha=alpha)
    if "jpegxl" in oiio.get_string_attribute("format_list"):
        write_image(folder / "plain.jxl", np.tile(image, (4, 4, 1)))
    levels = Image.fromarray((255 * image).astype(np.uint8))
    about = {"exif": b"Exif\0\0" + exif(), "icc_profile": profiles.SCANNER}
    for extension in ("png", "jpg", "webp"):
        message = about if extension == "png" else about | {"xmp": packet()}
        levels.save(folder / f"file.{extension}", **message)
        frame = read_frame(folder / f"file.{extension}")
    write_frame(folder / "file.tif", frame, frame.image)
    for number, compression in enumerate(("none", "rle", "zips", "piz", "pxr24", "b44", "dwaa", "dwab")):
        spec = oiio.ImageSpec(32, 24, 5, "half")
        spec.channelnames = ("R", "G", "B", "A", "Z")
        spec.channelformats = (*[oiio.TypeHalf] * 4, oiio.TypeFloat)
        spec.attribute("compression", compression)
        spec.tile_width = spec.tile_height = 16 * (number % 2)
        path = str(folder / f"{compression}.exr")
        output = oiio.ImageOutput.create(path)
        assert output.open(path, spec), output.geterror()
        assert output.write_image(rng.random((24, 32, 5)).astype(np.float32)), output.geterror()
        assert output.close()
    return sorted(folder.iterdir())


EDITS = st.lists(
    st.tuples(
        st.sampled_from(["flip", "set", "cut", "insert"]),
        st.booleans(),
        st.floats(0, 1),
        st.binary(min_size=1, max_size=40),
    ),
    min_size=1,
    max_size=6,
)


def damage(data, edits):
    """Apply edits to bytes, near the start of the file or anywhere."""
    data = bytearray(data)
    for kind, anywhere, place, payload in edits:
        at = int(place * (len(data) - 1 if anywhere else min(len(data) - 1, HEADER))) if data else 0
        if kind == "insert":
            data[at:at] = payload
        elif kind == "cut":
            del data[at : at + len(payload) ** 2]
        elif data:
            data[at] = data[at] ^ (1 << payload[0] % 8) if kind == "flip" else payload[0]
    return bytes(data)


def read_everything(path):
    """Let every reader have a go at the file, and write a frame back into it."""
    for reader in (image_info, read_disparity, read_depth):
        clean(reader, path)
    frame = clean(read_frame, path)
    if frame is not None:
        for extension in ("exr", "jpg", "tif"):
            clean(write_frame, path.with_name(f"out.{extension}"), frame, frame.image)


def fuzz(original, number):
    """Damage one file in many ways."""
    data = original.read_bytes()
    path = original.with_name(f"damaged{original.suffix}")

    @seed(number)
    @settings(
        max_examples=FILES_PER_FORMAT,
        deadline=SECONDS_PER_FILE * 1000,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(EDITS)
    def run(edits):
        path.write_bytes(damage(data, edits))
        read_everything(path)

    run()


def main(seconds):
    """Go through all files once, and again until the time is up."""
    if os.name == "posix":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
    with tempfile.TemporaryDirectory() as folder:
        originals = valid_files(Path(folder))
        end, number = time.monotonic() + seconds, 0
        while number == 0 or time.monotonic() < end:
            for original in originals:
                fuzz(original, number)
            number += 1


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 0.0)

"""EXR files as compositors have them, written with the decoder's own library: not a test itself."""

from itertools import chain

import numpy as np
import OpenImageIO as oiio  # noqa: N813

_TYPES = {"half": oiio.TypeHalf, "float": oiio.TypeFloat, "uint": oiio.TypeUInt32}
_FIELDS = ("x", "y", "full_x", "full_y", "full_width", "full_height", "tile_width", "tile_height")


def write_exr(path, *parts):
    """Write parts: dictionaries with ``channels`` {name: (type, (H, W) array)} and attributes."""
    specs = [_spec(index, **part) for index, part in enumerate(parts)]
    output = oiio.ImageOutput.create(str(path))
    opened = output.open(str(path), tuple(specs)) if len(specs) > 1 else output.open(str(path), specs[0])
    assert opened, output.geterror()
    for index, part in enumerate(parts):
        assert not index or output.open(str(path), specs[index], "AppendSubimage"), output.geterror()
        arrays = [np.asarray(array, np.float32) for _, array in part["channels"].values()]
        assert output.write_image(np.ascontiguousarray(np.stack(arrays, -1))), output.geterror()
    assert output.close()
    return path


def _spec(index, channels, attributes=None, **fields):
    height, width = next(iter(channels.values()))[1].shape
    kinds = [kind for kind, _ in channels.values()]
    spec = oiio.ImageSpec(width, height, len(channels), kinds[0])
    spec.channelnames = tuple(channels)
    if len(set(kinds)) > 1:
        spec.channelformats = tuple(_TYPES[kind] for kind in kinds)
    spec.attribute("oiio:subimagename", f"part{index}")
    for name, value in fields.items():
        assert name in _FIELDS
        setattr(spec, name, value)
    for name, value in (attributes or {}).items():
        spec.attribute(name, *value) if isinstance(value, tuple) else spec.attribute(name, value)
    return spec


def read_channels(path, part=0):
    """Read all channels of a part with the decoder alone: {name: (type, (H, W) float array)}."""
    source = oiio.ImageInput.open(str(path))
    assert source.seek_subimage(part, 0)
    spec = source.spec()
    values = source.read_image(part, 0, 0, spec.nchannels, "float").reshape(spec.height, spec.width, -1)
    source.close()
    return {name: (str(spec.channelformat(i)), values[..., i]) for i, name in enumerate(spec.channelnames)}


def read_spec(path, part=0):
    """Return the decoder's description of a part."""
    source = oiio.ImageInput.open(str(path))
    assert source.seek_subimage(part, 0)
    spec = source.spec()
    source.close()
    return spec


def deep_samples(seed=0, height=16, width=20, most=4, volumes=False):
    """Make random samples front to back: lists (H, W) of lists of dictionaries by channel."""
    rng = np.random.default_rng(seed)
    pixels = []
    for _ in range(height * width):
        count = int(rng.integers(0, most))
        near = np.sort(rng.uniform(1, 9, count)).astype(np.float32)
        far = near + rng.uniform(0.1, 4, count).astype(np.float32) if volumes else near
        cover = rng.uniform(0, 1, count).astype(np.float16)
        colours = rng.uniform(0, 1, (count, 3)) * cover[:, None]
        pixels.append(
            [
                dict(zip("RGB", colours[i].astype(np.float16), strict=True))
                | {"A": cover[i], "Z": near[i], "ZBack": far[i]}
                for i in range(count)
            ]
        )
    return [pixels[row * width : (row + 1) * width] for row in range(height)]


def write_deep(
    path, pixels, *, channels=("R", "G", "B", "A", "Z", "ZBack"), tile=0, compression="zips", x=0, y=0
):
    """Write samples, as :func:`deep_samples` gives them, with the decoder's own library."""
    height, width = len(pixels), len(pixels[0])
    spec = oiio.ImageSpec(width, height, len(channels), "float")
    spec.channelnames, spec.deep = channels, True
    spec.channelformats = tuple(oiio.TypeHalf if name in "RGBA" else oiio.TypeFloat for name in channels)
    spec.attribute("compression", compression)
    spec.tile_width = spec.tile_height = tile
    spec.x, spec.y = x, y
    data = oiio.DeepData()
    data.init(spec)
    for index, samples in enumerate(chain.from_iterable(pixels)):
        data.set_samples(index, len(samples))
        for number, sample in enumerate(samples):
            for channel, name in enumerate(channels):
                data.set_deep_value(index, channel, number, float(sample[name]))
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    ends = (x, x + width, y, y + height)
    written = (
        output.write_deep_tiles(*ends, 0, 1, data)
        if tile
        else output.write_deep_scanlines(y, y + height, 0, data)
    )
    assert written, output.geterror()
    assert output.close()
    return path

"""EXR files as compositors have them, written with the decoder's own library: not a test itself."""

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

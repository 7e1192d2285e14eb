"""Choice of the channels of a map by their names."""

from collections.abc import Sequence
from pathlib import Path

from bokehnet.errors import ImageFileError
from bokehnet.io.pixels import ImageFile, Part
from bokehnet.io.selection.picture import find_picture

__all__ = ["depth_channels", "find_map_channels", "picture_depth_channel"]

# Names of depth-like channels, best first.
_BARE_NAMES = ("z", "depth.z", "depth.v", "depth", "disparity", "y")
# Under a layer, a bare z is less specific than depth.z.
_LAYER_NAMES = ("depth.z", "depth.v", "depth", "disparity", "z", "y")


def depth_channels(names: Sequence[str]) -> list[str]:
    """Return the ``names`` that look like depth or disparity, best match first.

    Bare names come before names under a layer; Y and Z of a vector, as in normals, do not count.
    """
    return list(dict.fromkeys(name for group in _depth_groups(names) for name in group))


def picture_depth_channel(path: Path | str) -> str | None:
    """Return the depth channel of an EXR picture, for :func:`read_depth`; None if there is none.

    Args:
        path: Any image file.

    Raises:
        ImageFileError: The file cannot be read, or several channels match.
    """
    with ImageFile(path) as file:
        if file.headers is None:
            return None
        picture = find_picture(file)
        layer = picture.colours[0].rpartition(".")[0].rpartition(".")[0]
        stored = [(part, name) for part in file.parts for name in part.channels]
        candidates = [
            (part, name)
            for part, name in stored
            if name.lower().rpartition(".")[2] in ("z", "depth")
            or name.lower().endswith(("depth.v", "depth.y"))
            if not _is_vector(name, part.channels) and name not in picture.colours
        ]
        same_part = [(part, name) for part, name in candidates if part.index == picture.part.index]
        same_layer = [(part, name) for part, name in same_part if layer and name.startswith(layer + ".")]
        bare = [(part, name) for part, name in same_part if name.lower() in _BARE_NAMES]
        for group in (same_layer, bare, same_part, candidates):
            if len(group) == 1:
                part, name = group[0]
                ambiguous = sum(name == other for _, other in stored) > 1
                return f"{part.name}.{name}" if ambiguous and part.name else name
        if candidates:
            names = ", ".join(name for _, name in candidates)
            raise ImageFileError(
                f"{path}: which channel is the depth? Give the file as depth and name one of {names}"
            )
        return None


def find_map_channels(file: ImageFile, channel: str | None) -> tuple[Part, list[str]]:
    """Return the part and the channels of a map: one channel, or R, G, B if there is nothing else.

    Args:
        file: Open file.
        channel: See :func:`bokehnet.io.maps.read_map`.

    Raises:
        ImageFileError: There is no such channel, or the choice is ambiguous.
    """
    stored = [(part, name) for part in file.parts for name in part.channels]
    names = [name for _, name in stored]
    full_names = ", ".join(
        f"{part.name}.{name}" if part.name and names.count(name) > 1 else name for part, name in stored
    )
    groups = _depth_groups(names)
    if channel is None and groups and len(groups[0]) == 1:
        channel = groups[0][0]
    if channel is not None:
        matches = [(part, name) for part, name in stored if channel == name]
        matches = matches or [(part, name) for part, name in stored if channel == f"{part.name}.{name}"]
        if not matches:  # the only scalar of that name in a layer
            matches = [(part, name) for part, name in stored if name.endswith(f".{channel}")]
            matches = [(part, name) for part, name in matches if not _is_vector(name, part.channels)]
        if not matches:
            raise ImageFileError(f"{file.path}: no channel {channel!r}, found {full_names}")
        if len(matches) > 1:
            raise ImageFileError(
                f"{file.path}: {len(matches)} channels are called {channel!r}; name one of {full_names}"
            )
        return matches[0][0], [matches[0][1]]
    first = file.parts[0]
    names = [name for name in first.channels if name != first.alpha]
    if not groups and len(file.parts) == 1 and (len(names) == 1 or names == ["R", "G", "B"]):
        return first, names
    raise ImageFileError(f"{file.path}: which channel is the map? Name one of {full_names}")


def _depth_groups(names: Sequence[str]) -> list[list[str]]:
    """Group depth-like names by the pattern they match, best first; empty groups are omitted."""
    scalars = [name for name in names if not _is_vector(name, names)]
    bare = [[name for name in scalars if name.lower() == pattern] for pattern in _BARE_NAMES]
    layered = [[name for name in scalars if name.lower().endswith("." + pattern)] for pattern in _LAYER_NAMES]
    return [group for group in bare + layered if group]


def _is_vector(name: str, names: Sequence[str]) -> bool:
    layer, dot, last = name.rpartition(".")
    return last in ("Y", "Z") and layer + dot + "X" in names

"""Where the depth of a picture comes from: one class for each kind, from arrays or from files alike.

A source says what it needs when it is made, and gives a :class:`DepthMap` when it is asked for that of a
picture. To add a source: a class with ``depth_map`` in a file of its own, a field of ``InputSettings`` that
picks it, and a line in :func:`depth_source`.
"""

from pathlib import Path

import numpy as np

from bokehnet.scene.depth.depth_map import DepthMap, DepthSource, Photo
from bokehnet.scene.depth.embedded_depth import EmbeddedDepth
from bokehnet.scene.depth.given_depth import ConstantDisparity, DefocusMap, MetricDepth, RelativeDisparity
from bokehnet.scene.depth.layer_files import LayeredDepth
from bokehnet.scene.depth.network_depth import NetworkDepth
from bokehnet.settings.settings import RenderSettings

__all__ = [
    "ConstantDisparity",
    "DefocusMap",
    "DepthMap",
    "DepthSource",
    "EmbeddedDepth",
    "LayeredDepth",
    "MetricDepth",
    "NetworkDepth",
    "Photo",
    "RelativeDisparity",
    "depth_source",
    "tells_distances",
    "unit_of_own_depth",
]


def depth_source(settings: RenderSettings) -> DepthSource:
    """Return the source that the settings name; without any, what a phone's photo holds.

    Examples:
        >>> from bokehnet.settings.settings import DepthSettings, InputSettings
        >>> settings = RenderSettings(input=InputSettings(depth="z.exr"), depth=DepthSettings(unit="cm"))
        >>> source = depth_source(settings)
        >>> source.origin, source.kind, source.unit
        ('input.depth', 'metric', 'cm')
    """
    given, reading = settings.input, settings.depth
    if given.disparity is not None:
        return RelativeDisparity(
            map=given.disparity,
            channel=given.channel,
            invert=reading.invert,
            value_range=reading.value_range,
            as_stored=reading.as_stored,
        )
    if given.layers is not None:
        return LayeredDepth(layers=given.layers, unit=reading.unit or "m")
    if given.depth is not None:
        return MetricDepth(map=given.depth, channel=given.channel, unit=reading.unit or "m")
    if given.defocus is not None:
        return DefocusMap(map=given.defocus, channel=given.channel)
    if given.depth_model is not None:
        return NetworkDepth(model=given.depth_model, convention=given.depth_convention or "")
    if given.constant_disparity is not None:
        return ConstantDisparity(value=given.constant_disparity)
    return EmbeddedDepth(relative=settings.camera.blur is not None)


def tells_distances(settings: RenderSettings, *, blur_pulled: bool = False) -> bool:
    """Whether what the settings name tells distances; else relative disparity, or blur itself.

    Args:
        settings: Name the source.
        blur_pulled: Whether blur changes over a sequence, which makes a phone's map relative as blur does.

    Examples:
        >>> from bokehnet.settings.settings import InputSettings
        >>> tells_distances(RenderSettings(input=InputSettings(depth="z.exr")))
        True
    """
    source = depth_source(settings)
    return source.kind == "metric" and not (blur_pulled and isinstance(source, EmbeddedDepth))


def unit_of_own_depth(source: DepthSource, path: Path | str) -> str | None:
    """Unit of length of depth that a picture's own file holds; None where the depth is from elsewhere.

    Args:
        source: Tells the depth.
        path: File of the picture.

    Examples:
        >>> unit_of_own_depth(MetricDepth(map="deep.exr", unit="cm"), "deep.exr")
        'cm'
        >>> unit_of_own_depth(MetricDepth(map="z.exr"), "deep.exr")
    """
    if isinstance(source, EmbeddedDepth):
        return "m" if source.map is None and not source.relative else None
    if not isinstance(source, MetricDepth) or isinstance(source.map, np.ndarray) or source.unit == "1/m":
        return None
    return source.unit if Path(source.map).resolve() == Path(path).resolve() else None

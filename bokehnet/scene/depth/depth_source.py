"""Depth sources: one class per kind, for arrays and files.

A source takes its parameters in the constructor and returns a :class:`DepthMap` for a picture. To add a
source, write a class with ``depth_map`` in a file of its own, a field of ``InputSettings`` that selects it,
and a line in :func:`depth_source`.
"""

from pathlib import Path

import numpy as np

from bokehnet.io.depth.units import parse_depth_unit
from bokehnet.scene.depth.depth_map import DepthMap, DepthSource, Photo
from bokehnet.scene.depth.embedded_depth import EmbeddedDepth
from bokehnet.scene.depth.explicit_depth import ConstantDisparity, DefocusMap, MetricDepth, RelativeDisparity
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
    "gives_metric_depth",
    "unit_of_picture_depth",
]


def depth_source(settings: RenderSettings) -> DepthSource:
    """Return the source that the settings name; by default the depth stored in the picture's file.

    Examples:
        >>> from bokehnet.settings.settings import DepthSettings, InputSettings
        >>> settings = RenderSettings(input=InputSettings(depth="z.exr"), depth=DepthSettings(unit="cm"))
        >>> source = depth_source(settings)
        >>> source.origin, source.kind, source.unit
        ('input.depth', 'metric', 'cm')
    """
    inputs, reading = settings.input, settings.depth
    if inputs.disparity is not None:
        return RelativeDisparity(
            map=inputs.disparity,
            channel=inputs.channel,
            invert=reading.invert,
            value_range=reading.value_range,
            as_stored=reading.as_stored,
            coding=reading.coding,
            no_data=reading.no_data,
            holes=reading.holes,
        )
    if inputs.layers is not None:
        return LayeredDepth(layers=inputs.layers, unit=reading.unit or "m")
    if inputs.depth is not None:
        return MetricDepth(
            map=inputs.depth,
            channel=inputs.channel,
            unit=reading.unit,
            coding=reading.coding,
            measured=reading.kind,
            near=reading.near,
            far=reading.far,
            no_data=reading.no_data,
            holes=reading.holes,
            view=settings.camera,
        )
    if inputs.defocus is not None:
        return DefocusMap(map=inputs.defocus, channel=inputs.channel)
    if inputs.depth_model is not None:
        return NetworkDepth(model=inputs.depth_model, convention=inputs.depth_convention or "")
    if inputs.constant_disparity is not None:
        return ConstantDisparity(value=inputs.constant_disparity)
    camera = settings.camera
    metric = (camera.f_number, camera.focal_length, camera.sensor_width, settings.focus.distance)
    return EmbeddedDepth(
        relative=camera.blur is not None or camera.strength is not None,
        relative_estimate=metric == (None,) * 4,
    )


def gives_metric_depth(settings: RenderSettings, *, blur_pulled: bool = False) -> bool:
    """Return whether the source that the settings name yields metric depth.

    Args:
        settings: Settings that name the source.
        blur_pulled: True if the blur changes over a sequence, for which a phone's map is relative.

    Examples:
        >>> from bokehnet.settings.settings import InputSettings
        >>> gives_metric_depth(RenderSettings(input=InputSettings(depth="z.exr")))
        True
    """
    source = depth_source(settings)
    return source.kind == "metric" and not (blur_pulled and isinstance(source, EmbeddedDepth))


def unit_of_picture_depth(source: DepthSource, path: Path | str) -> str | None:
    """Return the unit of length of depth in the picture's own file; None for any other source.

    Args:
        source: Depth source.
        path: File of the picture.

    Examples:
        >>> unit_of_picture_depth(MetricDepth(map="deep.exr", unit="cm"), "deep.exr")
        'cm'
        >>> unit_of_picture_depth(MetricDepth(map="z.exr"), "deep.exr")
    """
    if isinstance(source, EmbeddedDepth):
        return "m" if source.map is None and not source.relative else None
    if not isinstance(source, MetricDepth) or isinstance(source.map, np.ndarray):
        return None
    unit = source.unit or "m"
    if parse_depth_unit(unit).is_disparity or source.measured != "planar" or source.near is not None:
        return None
    return unit if Path(source.map).resolve() == Path(path).resolve() else None

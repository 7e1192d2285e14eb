"""Layouts of pictures that no single lens saw: panoramas around the viewer and stereo pairs."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from bokehnet.engines.engine import Engine
from bokehnet.errors import ParameterError
from bokehnet.progress import Progress, ignore_progress, part_of
from bokehnet.render.exposure.exposure import Optics, expose
from bokehnet.render.result import RenderResult
from bokehnet.scene.scene import FocusedScene
from bokehnet.settings.settings import RenderSettings

__all__ = ["expose_layout"]

# Ratio of the widths of discs in neighbouring bands of a panorama, and the largest width over height.
_BAND_RATIO, _MAX_STRETCH = 1.15, 10.0

# Arrays of a result, by name.
_ARRAYS = ("bokeh", "alpha", "classical", "neural", "error_map", "defocus", "expected_error")


def expose_layout(
    scene: FocusedScene, settings: RenderSettings, engine: Engine, optics: Optics, report: Progress
) -> RenderResult:
    """Expose a panorama or a stereo pair; arguments as for :func:`bokehnet.render.exposure.exposure.expose`.

    A row at the latitude phi of an equirectangular panorama is stretched by 1 / cos(phi), and so are its
    discs. The picture is exposed in bands of nearly equal stretch, blended into each other, whose columns
    continue across the seam. The eyes of a stereo pair are exposed one by one.

    Raises:
        ParameterError: The scene has known edges, or is supersampled.

    Examples:
        >>> from bokehnet.render.renderer import BokehRenderer
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> from bokehnet.scene.scene import make_scene
        >>> lamp = np.full((40, 80, 3), 0.01, np.float32)
        >>> lamp[20, 0] = 9
        >>> scene = make_scene(lamp, ConstantDisparity(value=0))
        >>> changes = {"input": {"projection": "equirect"}, "camera": {"blur": 4}, "focus": {"value": 1}}
        >>> bokeh = BokehRenderer("scatter").render(scene, RenderSettings().updated(changes)).bokeh
        >>> bool(bokeh[20, -2, 0] > 0.1)  # across the seam
        True
    """
    name = "projection" if settings.input.projection != "flat" else "stereo"
    if scene.known is not None or scene.layers is not None or scene.supersampled > 1:
        raise ParameterError(
            f"input.{name}", expected="flat or none for a picture whose edges are known", shown="both"
        )

    def exposed(part: FocusedScene, progress: Progress | None) -> RenderResult:
        return expose(part, settings, engine, optics, progress or ignore_progress, overwrite=False)

    if settings.input.stereo is None:
        return _panorama(scene, exposed, report)
    return _eyes(scene, settings.input.stereo, exposed, report)


def _eyes(
    scene: FocusedScene,
    stereo: str,
    exposed: Callable[[FocusedScene, Progress | None], RenderResult],
    report: Progress,
) -> RenderResult:
    """Expose each half of a picture alone."""
    axis = 1 if stereo == "side-by-side" else 0
    half = scene.defocus.shape[axis] // 2
    results = []
    for eye, part in enumerate((slice(None, half), slice(half, None))):
        rows, columns = (part, slice(None)) if axis == 0 else (slice(None), part)
        results.append(exposed(_cut(scene, rows, columns), part_of(report, eye, 2)))
    arrays = {
        name: None
        if getattr(results[0], name) is None
        else np.concatenate([getattr(one, name) for one in results], axis=axis)
        for name in _ARRAYS
    }
    return _merged(results, arrays)


def _panorama(
    scene: FocusedScene, exposed: Callable[[FocusedScene, Progress | None], RenderResult], report: Progress
) -> RenderResult:
    """Expose an equirectangular panorama band by band."""
    height, width = scene.defocus.shape
    latitude = (0.5 - (np.arange(height) + 0.5) / height) * math.pi
    stretch = np.minimum(1 / np.cos(latitude), _MAX_STRETCH)
    level = np.log(stretch) / math.log(_BAND_RATIO)
    bands = [
        (band, rows)
        for band in range(int(np.ceil(level.max())) + 1)
        for rows in _runs(np.abs(level - band) < 1)
    ]
    results: list[RenderResult] = []
    sums: dict[str, npt.NDArray[np.float64]] = {}
    for index, (band, rows) in enumerate(bands):
        factor = _BAND_RATIO**band
        radius = math.ceil(float(np.abs(scene.defocus).max())) + 1
        first, last = max(0, rows.start - 2 * radius), min(height, rows.stop + 2 * radius)
        margin = min(width, math.ceil(radius * factor))
        columns = np.arange(-margin, width + margin) % width
        part = _cut(scene, slice(first, last), columns)
        window = replace(part.window, x=scene.window.x - margin, width=len(columns), pixel_aspect=1 / factor)
        part = replace(part, defocus=part.defocus * np.float32(factor), window=window)
        result = exposed(part, part_of(report, index, len(bands)))
        results.append(result)
        weight = 1 - np.abs(level[rows] - band)
        for name in _ARRAYS:
            values = getattr(result, name)
            if values is not None:
                values = values[rows.start - first : rows.stop - first, margin : margin + width]
                total = sums.setdefault(name, np.zeros((height, *values.shape[1:])))
                total[rows] += weight.reshape(-1, *[1] * (values.ndim - 1)) * values
    arrays = {name: sums[name].astype(np.float32) if name in sums else None for name in _ARRAYS}
    arrays["defocus"] = scene.defocus
    largest = float(np.abs(scene.defocus).max())  # at the equator
    return _merged(results, arrays, largest)


def _cut(scene: FocusedScene, rows: slice, columns: slice | npt.NDArray[np.intp]) -> FocusedScene:
    """Return some rows and columns of a scene."""
    height, width = scene.defocus.shape
    row_range = range(*rows.indices(height))
    window = replace(scene.window, y=scene.window.y + row_range.start, height=len(row_range))
    if isinstance(columns, slice):
        column_range = range(*columns.indices(width))
        window = replace(window, x=window.x + column_range.start, width=len(column_range))

    def cut(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return np.ascontiguousarray(values[rows][:, columns])

    return replace(
        scene,
        image=cut(scene.image),
        defocus=cut(scene.defocus),
        alpha=None if scene.alpha is None else cut(scene.alpha),
        window=window,
    )


def _merged(
    results: list[RenderResult], arrays: dict[str, Any], largest: float | None = None
) -> RenderResult:
    """Return one result with the given arrays; its largest blur in pixels is by default that of all."""
    if largest is None:
        largest = max(result.report.largest_blur for result in results)
    report = replace(results[0].report, largest_blur=largest)
    return replace(results[0], **arrays, mixed_pixels=None, report=report)


def _runs(mask: npt.NDArray[np.bool_]) -> list[slice]:
    """Return the runs of True in a mask."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [slice(int(first), int(last)) for first, last in zip(ends[::2], ends[1::2], strict=True)]

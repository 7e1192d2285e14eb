"""Export in the background: the same file as by the shown command line, by the same steps."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from bokehnet.io.image import check_writable, write_map
from bokehnet.progress import Progress, part_of
from bokehnet.render.exposure.memory_bounds import check_memory
from bokehnet.render.output import check_output
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.scene import read_scene
from bokehnet.settings.settings import RenderSettings
from bokehnet.studio.opened import Opened

__all__ = ["render_file", "with_painted_map"]


def render_file(image: Path, output: Path, settings: RenderSettings, *, report: Progress) -> dict[str, Any]:
    """Read, render and write a picture, as ``bokehnet render`` does; a task of the worker process.

    Returns:
        Facts about the render, for display.

    Raises:
        BokehnetError: As for the command.
    """
    check_writable(output)
    check_output(output, settings.output)
    renderer = _renderer()
    renderer.check(settings)
    check_memory(image, settings)
    scene = read_scene(image, settings, progress=part_of(report, 0, 4))
    check_output(output, settings.output, scene.frame)
    focused = renderer.prepare(scene, settings, part_of(report, 1, 4))
    del scene
    result = renderer.render(focused, settings, part_of(report, 2, 4), overwrite=True)
    result.save(output, part_of(report, 3, 4))
    return {"engine": result.report.engine, "largest_blur": result.report.largest_blur}


@cache
def _renderer() -> BokehRenderer:
    """Return the renderer of the worker process, which keeps repaired maps from one export to the next."""
    return BokehRenderer()


def with_painted_map(
    opened: Opened, settings: RenderSettings, folder: Path, *, write: bool = True
) -> tuple[RenderSettings, Path | None]:
    """Write the painted map of a picture, and return settings that use it.

    Args:
        opened: Opened picture.
        settings: Settings of the render.
        folder: Folder for the map.
        write: True to write the map, False only to return its name.

    Returns:
        Settings, and the map's file; None if nothing is painted.
    """
    if not opened.strokes:
        return settings, None
    path = folder / f"{opened.path.stem}_painted.exr"
    depth = opened.scene.depth
    table = settings.to_table()
    source = {name: table.get("input", {}).get(name) for name in ("matte", "supersampled")}
    inputs = {name: value for name, value in source.items() if value is not None}
    reading = {"repair": "off", "mixed": "off"}
    if "pixel_filter" in table.get("depth", {}):
        reading["pixel_filter"] = table["depth"]["pixel_filter"]
    changes: dict[str, dict[str, Any]] = {
        "camera": dict(table.get("camera", {})),
        "focus": dict(table.get("focus", {})),
    }
    if write:
        scale, channel = (1000, "Z") if depth.kind == "metric" else (1, "Y")
        write_map(path, scale * opened.painted_map(settings), channel=channel)
    if depth.kind == "relative":
        changes |= {"input": {"disparity": str(path), **inputs}, "depth": {"value_range": [0, 1], **reading}}
    elif depth.kind == "metric":
        changes |= {
            "input": {"depth": str(path), "channel": "Z", **inputs},
            "depth": {"unit": "1/m", **reading},
        }
        for name in ("focal_length", "f_number", "sensor_width"):
            value = getattr(depth.camera, name, None)
            if name not in changes["camera"] and value is not None:
                changes["camera"][name] = float(value)
    else:
        changes |= {"input": {"defocus": str(path), **inputs}, "depth": reading}
    focus = opened.focus_of(settings)
    if not changes["focus"] and focus is not None and depth.kind != "defocus":
        metric = depth.kind == "metric"
        changes["focus"] = {"distance": 1 / (1000 * focus)} if metric else {"value": focus}
    without_source = replace(settings, input=RenderSettings().input, depth=RenderSettings().depth)
    return without_source.updated(changes), path

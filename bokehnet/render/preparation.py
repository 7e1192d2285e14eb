"""Preparation of a frame before the blur: depth repair and focus."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.engine_registry import RAY_ENGINES
from bokehnet.progress import Progress
from bokehnet.render.look import copy_tilt_gradient
from bokehnet.render.supersampling import at_rendered_size, rendered_surfaces, settings_in_fine_pixels
from bokehnet.scene.black_bars import BlackBars, find_black_bars
from bokehnet.scene.blur_warnings import unexpected_blur
from bokehnet.scene.focus import check_nothing_to_focus, focus_lens
from bokehnet.scene.known_edges import focused_layers, focused_surfaces, matte_surfaces
from bokehnet.scene.pixel_filter_choice import choose_filter
from bokehnet.scene.scene import (
    FocusedScene,
    Scene,
    check_repair_allowed,
    is_exact,
    is_repaired,
    map_at_picture_size,
)
from bokehnet.settings.settings import InputSettings, RenderSettings

__all__ = ["prepare"]


def prepare(
    scene: Scene,
    settings: RenderSettings,
    engine: str,
    report: Progress,
    repairer: Callable[[], DisparityRepair],
    plan: RepairPlan | None = None,
) -> FocusedScene:
    """Repair the map of a scene and focus it; see :meth:`BokehRenderer.prepare`.

    Args:
        scene: Scene to prepare.
        settings: Checked settings of the render.
        engine: Name of the engine that will render.
        report: Progress callback of the repair; an exception that it raises ends the repair.
        repairer: Factory of the depth repair, called on demand.
        plan: Repair plan of the shot, if there is one.

    Examples:
        >>> import numpy as np
        >>> from bokehnet.scene.depth.depth_source import RelativeDisparity
        >>> from bokehnet.scene.scene import make_scene
        >>> disparity = np.tile(np.linspace(0, 1, 32, dtype=np.float32), (24, 1))
        >>> scene = make_scene(np.ones((24, 32, 3), np.float32), RelativeDisparity(map=disparity))
        >>> changes = {"camera": {"blur": 8}, "focus": {"value": 1}, "depth": {"repair": "off"}}
        >>> settings = RenderSettings().updated(changes)
        >>> float(prepare(scene, settings, "rays", lambda done, total: None, DisparityRepair).defocus.min())
        -8.0
    """
    report(0, 1)
    original, scene = scene, at_rendered_size(scene)
    check_repair_allowed(scene, settings.depth)
    values = map_at_picture_size(scene, settings.depth)
    layout = _words_of_layout(settings.input)
    bars = None if layout else _bars_of(scene)
    if bars is not None:
        values = bars.inside(values)
        scene = replace(
            scene,
            image=bars.inside(scene.image),
            depth=replace(scene.depth, values=values),
            window=bars.window_inside(scene.window),
        )
        original = scene
    ends = float(values.min()), float(values.max())
    lens, repaired, reason, notes, repair = None, None, "", scene.notes, None
    if scene.depth.kind == "defocus":
        check_nothing_to_focus(settings)
    elif is_repaired(scene, settings.depth):
        repair = repairer().repair(scene.image, values, settings.depth.repair, report, plan)
        values, repaired, reason = repair.disparity, repair.repaired, repair.reason
    known, matte = scene.known, scene.alpha if scene.matte is None else scene.matte
    if known is None and matte is not None and not is_exact(scene):
        known = matte_surfaces(matte, values)
    if scene.depth.kind == "defocus":
        known = focused_surfaces(known, values, None, scene.supersampled)
        values = values if scene.supersampled == 1 else scene.supersampled * values
    else:
        depth, fine = (
            replace(scene.depth, values=values),
            settings_in_fine_pixels(settings, scene.supersampled),
        )
        lens = focus_lens(depth, scene.window, fine.focus, fine.camera, scene.image)
        lens = replace(lens, tilt_gradient=copy_tilt_gradient(settings.lens, lens, scene.window))
        known = focused_surfaces(known, values, lens)
        values = lens.defocus(values)
        if settings.input.stereo == "side-by-side" and scene.depth.kind == "metric":
            values = values / np.float32(2)  # half of the picture spans the sensor
        notes += unexpected_blur(scene.depth, ends, lens, values)
    choice = choose_filter(original, settings.depth.pixel_filter) if engine in RAY_ENGINES else None
    image = scene.image
    if original.supersampled > scene.supersampled:
        radii = lens.defocus if lens is not None else partial(np.multiply, np.float32(scene.supersampled))
        pixel_filter = None if choice is None else choice.specified_or_default
        image, values, known = rendered_surfaces(original, radii, pixel_filter)
    return FocusedScene(
        image=image,
        defocus=values,
        alpha=scene.alpha,
        window=scene.window,
        number=scene.number,
        frame=scene.frame,
        lens=lens,
        repaired=repaired,
        repair_reason=reason,
        repair_plan=None if repair is None else repair.plan,
        pixel_filter=choice,
        notes=notes,
        known=known,
        supersampled=scene.supersampled,
        layers=focused_layers(scene.depth.layers, lens),
        reading=(*scene.depth.reading, *_pixel_shape(scene.window.pixel_aspect), *_words_of(bars), *layout),
        bars=bars,
    )


def _pixel_shape(aspect: float) -> tuple[str, ...]:
    """Return words for the summary about pixels that are not square."""
    return () if aspect == 1 else (f"pixels {aspect:.3g} times as wide as high",)


def _bars_of(scene: Scene) -> BlackBars | None:
    """Return the black bars of an opaque picture without further information about its edges."""
    is_plain = scene.known is None and scene.matte is None and scene.depth.layers is None
    is_plain = is_plain and scene.alpha is None
    return find_black_bars(scene.image) if is_plain and scene.supersampled == 1 else None


def _words_of(bars: BlackBars | None) -> tuple[str, ...]:
    """Return words for the summary about black bars."""
    if bars is None:
        return ()
    names = ("top", "bottom", "left", "right")
    widths = ", ".join(f"{name} {width}" for name in names if (width := getattr(bars, name)))
    return (f"black bars kept ({widths} px)",)


def _words_of_layout(settings: InputSettings) -> tuple[str, ...]:
    """Return words for the summary about the layout of the picture."""
    projection = () if settings.projection == "flat" else (f"projection {settings.projection}",)
    return projection if settings.stereo is None else (*projection, f"stereo {settings.stereo}")

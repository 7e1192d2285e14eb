"""Preparation of a frame before the blur: depth repair and focus."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.engine_registry import RAY_ENGINES
from bokehnet.optics.pixels.pixel_filter import FilterChoice
from bokehnet.progress import Progress
from bokehnet.scene.black_bars import BlackBars
from bokehnet.scene.blur_warnings import unexpected_blur
from bokehnet.scene.focus import check_lens, focus_lens, is_automatic
from bokehnet.scene.focus_checks import check_nothing_to_focus
from bokehnet.scene.fringes import fringe_surfaces
from bokehnet.scene.known_edges import focused_layers, focused_surfaces, matte_surfaces
from bokehnet.scene.pixel_filter_choice import choose_filter
from bokehnet.scene.preparation.picture_cache import PictureCache, array_digest
from bokehnet.scene.preparation.recovered_light import LightAtPixels, bars_of, light_at_pixels
from bokehnet.scene.preparation.rendered_size import (
    at_rendered_size,
    rendered_surfaces,
    settings_in_fine_pixels,
)
from bokehnet.scene.prescription import copy_tilt_gradient
from bokehnet.scene.scene import (
    FocusedScene,
    Scene,
    check_repair_allowed,
    is_exact,
    is_repaired,
    map_at_picture_size,
)
from bokehnet.scene.subject import Subject, find_subject
from bokehnet.settings.settings import FocusSettings, InputSettings, RenderSettings

__all__ = ["prepare"]

Array = npt.NDArray[np.float32]


class _Map(NamedTuple):
    """Map of a picture, repaired or not.

    Attributes:
        values: Map in the size of the picture, (H, W).
        ends: Smallest and largest value before the repair.
        repaired: True if edges were moved; None if the repair did not run.
        reason: Reason of the repair or its absence.
        plan: Decisions of the repair.
    """

    values: Array
    ends: tuple[float, float]
    repaired: bool | None = None
    reason: str = ""
    plan: RepairPlan | None = None


# Deviation of the width of a panorama from twice its height, fraction of the width.
_MAX_PANORAMA_ERROR = 0.01

# Blur radii from which recovered light is used, partly and altogether, pixels.
_RECOVERED_RADII_PX = 0.5, 2.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Picture:
    """Scene with everything that does not depend on focus and blur.

    Attributes:
        original: Scene as read.
        scene: Scene at the size of its render.
        map: Map at that size, repaired.
        known: Both surfaces of pixels at edges, in the unit of the map, where they are known.
        pixel_filter: Pixel filter for unmixing at edges; None if the engine does no unmixing.
        subject: Function that returns the subject.
        light: Recovered light of the clipped pixels.
        bars: Black bars around these arrays; None without bars.
    """

    original: Scene
    scene: Scene
    map: _Map
    known: KnownSurfaces | None
    pixel_filter: FilterChoice | None
    subject: Callable[[], Subject]
    light: LightAtPixels
    bars: BlackBars | None = None


def prepare(
    scene: Scene,
    settings: RenderSettings,
    engine: str,
    report: Progress,
    repairer: Callable[[], DisparityRepair],
    plan: RepairPlan | None = None,
    cache: PictureCache | None = None,
) -> FocusedScene:
    """Repair the map of a scene and focus it; see :meth:`BokehRenderer.prepare`.

    Args:
        scene: Scene to prepare.
        settings: Checked settings of the render.
        engine: Name of the engine that will render.
        report: Progress callback of the repair; an exception that it raises ends the repair.
        repairer: Factory of the depth repair, called on demand.
        plan: Repair plan of the shot, if there is one.
        cache: Cache of the results that depend on the picture alone; None computes them.

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
    picture = _prepare_picture(scene, settings, engine, report, repairer, plan, cache)
    focused = _focus_picture(picture, settings)
    if cache is None or cache.max_bytes == 0 or settings.engine.max_memory is not None:
        return focused
    picture = replace(picture, subject=partial(find_subject, picture.scene.image, picture.map.values))
    return replace(focused, focus_again=partial(_focus_again, picture, settings))


def _prepare_picture(
    scene: Scene,
    settings: RenderSettings,
    engine: str,
    report: Progress,
    repairer: Callable[[], DisparityRepair],
    plan: RepairPlan | None = None,
    cache: PictureCache | None = None,
) -> _Picture:
    """Return a scene with its repaired map and pixel filter, from the cache if it has them.

    Arguments are those of :func:`prepare`.
    """
    report(0, 1)
    original, scene = scene, at_rendered_size(scene)
    check_repair_allowed(scene, settings.depth)
    if scene.depth.kind != "defocus":  # before the slow repair
        fine = settings_in_fine_pixels(settings, scene.supersampled)
        check_lens(scene.depth, scene.window, fine.focus, fine.camera)
    bars = bars_of(scene, settings.input)
    if bars is not None:
        original = scene = replace(
            scene,
            image=bars.inside(scene.image),
            depth=replace(scene.depth, values=bars.inside(map_at_picture_size(scene, settings.depth))),
            window=bars.window_inside(scene.window),
            extra_light=None if scene.extra_light is None else bars.inside(scene.extra_light),
        )
    if scene.depth.kind == "defocus":
        check_nothing_to_focus(settings)
    if cache is None or cache.max_bytes == 0 or plan is not None:
        cache = PictureCache(0)
    digests: tuple[Any, ...] = ()
    if cache.max_bytes:
        digests = (array_digest(original.image), array_digest(original.depth.values), original.supersampled)
    key = (digests, scene.depth.kind, scene.depth.filtered, scene.depth.fits_any_size, settings.depth)
    is_read = scene.depth.kind == "defocus" or is_exact(scene)  # no copy of a map that is used as it is
    maps = PictureCache(0) if is_read else cache
    final = maps.get(
        ("map", *key),
        lambda: _final_map(scene, settings, report, repairer, plan, is_kept=maps.max_bytes > 0),
        lambda map: map.values,
    )
    known_light = scene.light_sums if scene.extra_light is None else scene.extra_light
    sums = None if known_light is None else array_digest(known_light)
    light = cache.get(
        ("light", *key, sums, settings.highlights.threshold, settings.highlights.strength),
        lambda: light_at_pixels(scene, final.values, settings.highlights, bars),
    )
    known, matte = scene.known, scene.alpha if scene.matte is None else scene.matte
    if known is None and matte is not None and not is_exact(scene):
        known = matte_surfaces(matte, final.values)
    elif known is None and engine in RAY_ENGINES and plan is None and is_repaired(scene, settings.depth):
        known = _estimated_surfaces(scene, final.values, light, cache, key)
    choice = None
    if engine in RAY_ENGINES:
        renderer = None if original.frame is None else original.frame.renderer
        choice = cache.get(
            ("filter", digests, renderer, settings.depth.pixel_filter),
            lambda: choose_filter(original, settings.depth.pixel_filter),
        )
    return _Picture(
        original=original,
        scene=scene,
        map=final,
        known=known,
        pixel_filter=choice,
        subject=lambda: cache.get(
            ("subject", *key),
            lambda: find_subject(scene.image, final.values),
            lambda subject: subject.mask,
        ),
        light=light,
        bars=bars,
    )


def _estimated_surfaces(
    scene: Scene, values: Array, light: LightAtPixels, cache: PictureCache, key: tuple[Any, ...]
) -> KnownSurfaces | None:
    """Return the surfaces of soft silhouettes, without recovered light: a clipped colour is no mixture.

    Args:
        scene: Scene at the size of its render.
        values: Its map, repaired, (H, W).
        light: Recovered light.
        cache: Cache of the picture.
        key: Key of its map.
    """
    surfaces = cache.get(
        ("fringes", *key),
        lambda: fringe_surfaces(scene.image, values),
        lambda estimated: np.zeros(0) if estimated is None else estimated,
    )
    if surfaces is None:
        return None
    places = surfaces.rows.astype(np.intp) * values.shape[1] + surfaces.columns
    return surfaces.select(~np.isin(places, light.pixels))


def _light_of_blurred(image: Array, light: LightAtPixels, defocus: Array) -> Array:
    """Return a picture with the recovered light of what is blurred.

    What is in focus stays as the camera recorded it: its recovered light would only be clipped again, in
    another colour.

    Args:
        image: Picture as read, scene-linear, (H, W, 3).
        light: Recovered light.
        defocus: Signed blur radius, pixels, (H, W).
    """
    if not light.pixels.size:
        return image
    low, high = _RECOVERED_RADII_PX
    radii = np.abs(defocus).reshape(-1)[light.pixels]
    weight = np.clip((radii - low) / (high - low), 0, 1).astype(np.float32)
    result = image.copy()
    shown, stored = result.reshape(-1, 3), image.reshape(-1, 3)[light.pixels]
    shown[light.pixels] = stored + weight[:, None] * (light.values - stored)
    return result


def _focus_picture(picture: _Picture, settings: RenderSettings) -> FocusedScene:
    """Return a prepared picture in focus.

    Args:
        picture: Picture, prepared with the same settings but for focus, camera and lens.
        settings: Settings of the render.

    Raises:
        BokehnetError: A setting of focus or camera is missing or does not apply.
    """
    original, scene, values, known = picture.original, picture.scene, picture.map.values, picture.known
    lens, notes = None, scene.notes
    if scene.depth.kind == "defocus":
        known = focused_surfaces(known, values, None, scene.supersampled)
        values = values if scene.supersampled == 1 else scene.supersampled * values
    else:
        depth = replace(scene.depth, values=values)
        fine = settings_in_fine_pixels(settings, scene.supersampled)
        subject = picture.subject() if is_automatic(fine.focus, depth) else None
        lens = focus_lens(depth, scene.window, fine.focus, fine.camera, scene.image, subject)
        lens = replace(lens, tilt_gradient=copy_tilt_gradient(settings.lens, lens, scene.window))
        if lens.subject is not None:
            focus = lens.subject.note(scene.window, scene.supersampled)
            lens = replace(lens, assumptions=(focus, *lens.assumptions))
        known = focused_surfaces(known, values, lens)
        values = lens.defocus(values)
        if settings.input.stereo == "side-by-side" and scene.depth.kind == "metric":
            values = values / np.float32(2)  # half of the picture spans the sensor
        notes += unexpected_blur(scene.depth, picture.map.ends, lens, values)
    image, choice = _light_of_blurred(scene.image, picture.light, values), picture.pixel_filter
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
        repaired=picture.map.repaired,
        repair_reason=picture.map.reason,
        repair_plan=picture.map.plan,
        pixel_filter=choice,
        notes=(*notes, *_projection_notes(settings.input, image)),
        known=known,
        supersampled=scene.supersampled,
        layers=focused_layers(scene.depth.layers, lens),
        assumptions=(
            *(scene.depth.assumptions if lens is None else lens.assumptions),
            *_pixel_shape(scene.window.pixel_aspect),
            *_words_of(picture.bars),
            *_words_of_layout(settings.input),
        ),
        bars=picture.bars,
        light=picture.light.note,
    )


def _final_map(
    scene: Scene,
    settings: RenderSettings,
    report: Progress,
    repairer: Callable[[], DisparityRepair],
    plan: RepairPlan | None,
    *,
    is_kept: bool,
) -> _Map:
    """Return the map of a scene at the size of its picture, repaired if the settings say so.

    A map that is kept shares no memory with its scene, whose arrays the caller may change.
    """
    values = map_at_picture_size(scene, settings.depth)
    ends = float(values.min()), float(values.max())
    final = _Map(values, ends)
    if is_repaired(scene, settings.depth):
        repair = repairer().repair(scene.image, values, settings.depth.repair, report, plan)
        final = _Map(repair.disparity, ends, repair.repaired, repair.reason, repair.plan)
    if is_kept and np.may_share_memory(final.values, scene.depth.values):
        return final._replace(values=final.values.copy())
    return final


def _focus_again(picture: _Picture, settings: RenderSettings, **changes: Any) -> FocusedScene:
    """Return a prepared picture with another focus; see :meth:`FocusedScene.refocus`."""
    tilts = {"tilt_x": settings.focus.tilt_x, "tilt_y": settings.focus.tilt_y}
    settings = replace(settings, focus=FocusSettings(**tilts | changes))
    return replace(_focus_picture(picture, settings), focus_again=partial(_focus_again, picture, settings))


def _pixel_shape(aspect: float) -> tuple[str, ...]:
    """Return words for the summary about pixels that are not square."""
    return () if aspect == 1 else (f"pixels {aspect:.3g} times as wide as high",)


def _words_of(bars: BlackBars | None) -> tuple[str, ...]:
    """Return words for the summary about black bars."""
    if bars is None:
        return ()
    names = ("top", "bottom", "left", "right")
    widths = ", ".join(f"{name} {width}" for name in names if (width := getattr(bars, name)))
    return (f"black bars kept ({widths} px)",)


def _projection_notes(settings: InputSettings, image: Array) -> tuple[str, ...]:
    """Return a warning about a panorama that cannot span 360 x 180 degrees."""
    height, width = image.shape[:2]
    if settings.projection == "flat" or abs(width - 2 * height) <= _MAX_PANORAMA_ERROR * width:
        return ()
    return (
        f"a panorama of 360 x 180 degrees is twice as wide as high, this one has {width}x{height} pixels: "
        "its poles or its seam lie elsewhere; extend the picture to 2:1, or leave out `input.projection`",
    )


def _words_of_layout(settings: InputSettings) -> tuple[str, ...]:
    """Return words for the summary about the layout of the picture."""
    projection = () if settings.projection == "flat" else (f"projection {settings.projection}",)
    return projection if settings.stereo is None else (*projection, f"stereo {settings.stereo}")

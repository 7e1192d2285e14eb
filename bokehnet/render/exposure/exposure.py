"""Exposure: blur of a focused scene by a lens, and the effects of the camera."""

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from bokehnet.effects import CameraEffects
from bokehnet.engine_registry import RAY_ENGINES
from bokehnet.engines.engine import Engine
from bokehnet.engines.expected_error import supports_expected_error
from bokehnet.engines.options import RenderOptions
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER
from bokehnet.optics.pixels.supersampling import downsample
from bokehnet.progress import Progress
from bokehnet.render.exposure import memory_bounds as memory
from bokehnet.render.exposure.lamp_light import add_lamp_light, lamps_of
from bokehnet.render.exposure.supersampling import (
    RAY_FRACTION,
    reduced_defocus,
    reduced_result,
    reduced_scene,
)
from bokehnet.render.look import make_highlights, picture_aberrations, picture_shading
from bokehnet.render.result import RenderReport, RenderResult
from bokehnet.scene.black_bars import BlackBars
from bokehnet.scene.scene import FocusedScene
from bokehnet.settings.error_names import errors_named_as
from bokehnet.settings.settings import RenderSettings

__all__ = ["Optics", "expose", "tilt_parameter"]

Array = npt.NDArray[np.float32]

# Smallest width over height of a blur disc in stored pixels; the largest is its inverse.
_MIN_SQUEEZE = 0.1

# Settings of the engine's parameters, for messages about them.
_PARAMETER_NAMES = {"gamma": "highlights.gamma", "engine": "name", "expected_error": "output.expected_error"}

# Aperture, lens and camera.
Optics = tuple[Aperture, LensResponse, CameraEffects | None]


def expose(
    scene: FocusedScene,
    settings: RenderSettings,
    engine: Engine,
    optics: Optics,
    report: Progress,
    overwrite: bool,
    cached: int = 0,
) -> RenderResult:
    """Blur a scene and apply the effects of the camera.

    Args:
        scene: Result of :func:`bokehnet.scene.preparation.preparation.prepare`.
        settings: Checked settings of the render.
        engine: Engine of the settings.
        optics: Aperture, lens and camera of the settings.
        report: Progress callback; an exception that it raises ends the render.
        overwrite: True if the result may overwrite image and defocus.
        cached: Bytes of the kept maps, which count towards a memory bound.

    Examples:
        >>> from bokehnet.optics.aperture import Aperture
        >>> from bokehnet.scene.depth.depth_source import DefocusMap
        >>> from bokehnet.render.renderer import BokehRenderer
        >>> from bokehnet.scene.scene import make_scene
        >>> radii = np.full((24, 32), 3, np.float32)  # pixels
        >>> scene = make_scene(np.ones((24, 32, 3), np.float32), DefocusMap(map=radii))
        >>> focused, optics = BokehRenderer().prepare(scene), (Aperture(), LensResponse(), None)
        >>> report = lambda done, total: None
        >>> expose(focused, RenderSettings(), Engine("scatter"), optics, report, False).report.largest_blur
        3.0
    """
    aperture, lens_response, effects = _optics_of_picture(scene, settings, engine, optics)
    overwrite = overwrite and settings.engine.max_memory is not None
    defocus, lens = scene.defocus, _lens_options(scene, settings, aperture, lens_response)
    keep = not overwrite or settings.output.save_maps is not None
    if keep and overwrite:  # the error map must not overwrite it
        defocus = defocus.view()
        defocus.flags.writeable = False
    lamps = lamps_of(scene.image, defocus, settings)
    occluders = defocus.copy() if lamps is not None and overwrite and not keep else defocus
    with errors_named_as("engine", _PARAMETER_NAMES | tilt_parameter(settings)):
        alpha = _spread_coverage(scene, defocus, engine, lens)
        options = replace(
            lens,
            gamma=settings.highlights.gamma,
            highlights=make_highlights(settings.highlights),
            memory_in_use=cached + _memory_in_use(scene, keep, overwrite),
            overwrite=overwrite,
            known=scene.known,
            layers=scene.layers,
            expected_error=_expects_error(settings, engine, lens_response),
        )
        rendered = engine.render(scene.image, defocus, report, options)
    factor, choice = scene.supersampled, scene.pixel_filter
    if factor > 1:
        pixel_filter = DEFAULT_FILTER if choice is None else choice.specified_or_default
        rendered = reduced_result(rendered, factor, pixel_filter)
        alpha = None if alpha is None else downsample(alpha, factor, pixel_filter)
        defocus = reduced_defocus(defocus, factor) if keep else defocus
        scene = reduced_scene(scene, rendered.bokeh, alpha)
        if lamps is not None:
            lamps, occluders = lamps.reduced(factor), reduced_defocus(occluders, factor)
    bokeh = add_lamp_light(rendered.bokeh, lamps, occluders, aperture, settings, scene.lens, scene.window)
    bokeh, alpha = _with_effects(bokeh, alpha, effects, scene)
    result = RenderResult(
        bokeh=bokeh,
        alpha=alpha,
        classical=rendered.classical,
        neural=rendered.neural,
        error_map=rendered.error_map,
        defocus=defocus if keep else None,
        mixed_pixels=rendered.mixed_pixels,
        expected_error=rendered.expected_error,
        supersampled=factor,
        frame=scene.frame,
        output=settings.output,
        report=_report(scene, engine, rendered.largest_blur),
    )
    return result if scene.bars is None else _with_bars(result, scene.bars)


def _with_bars(result: RenderResult, bars: BlackBars) -> RenderResult:
    """Return a result with the black bars of its picture around it."""
    names = ("bokeh", "alpha", "classical", "neural", "error_map", "defocus", "expected_error")
    arrays = {name: getattr(result, name) for name in names}
    larger: dict[str, Any] = {name: None if a is None else bars.around(a) for name, a in arrays.items()}
    mixed = result.mixed_pixels
    if mixed is not None:
        mixed = replace(mixed, rows=mixed.rows + bars.top, columns=mixed.columns + bars.left)
    return replace(result, **larger, mixed_pixels=mixed)


def _optics_of_picture(
    scene: FocusedScene, settings: RenderSettings, engine: Engine, optics: Optics
) -> Optics:
    """Return aperture, lens and camera, with aberrations and shading of a prescription lens."""
    aperture, lens_response, effects = optics
    if scene.window.pixel_aspect != 1:
        squeeze = aperture.squeeze / scene.window.pixel_aspect
        aperture = replace(aperture, squeeze=min(max(squeeze, _MIN_SQUEEZE), 1 / _MIN_SQUEEZE))
    if scene.lens is None:
        return aperture, lens_response, effects
    aberrations = picture_aberrations(settings.lens, scene.lens, scene.window)
    if shading := picture_shading(settings.lens, scene.lens, scene.window):
        effects = replace(effects or CameraEffects(), shading=shading)
    if aberrations is not None and engine.name in RAY_ENGINES:
        lens_response = replace(lens_response, aberration_map=lens_response.aberration_map + aberrations)
    return aperture, lens_response, effects


def _lens_options(
    scene: FocusedScene, settings: RenderSettings, aperture: Aperture, lens_response: LensResponse
) -> RenderOptions:
    """Return the options that the picture and its coverage share."""
    return RenderOptions(
        aperture=aperture,
        lens_response=lens_response,
        viewport=scene.window.viewport,
        pixel_filter=None if scene.pixel_filter is None else scene.pixel_filter.pixel_filter,
        rays_factor=RAY_FRACTION if scene.supersampled > 1 else 1.0,
        max_memory=settings.engine.max_memory,
    )


def _memory_in_use(scene: FocusedScene, keep: bool, overwrite: bool) -> int:
    """Return the memory of the program, the scene and the result, bytes, before the engine renders.

    Args:
        scene: Scene to render.
        keep: True if the result has the defocus.
        overwrite: True if the result overwrites the scene.
    """
    image, defocus = scene.image, scene.defocus
    memory_in_use = memory.PROGRAM + image.nbytes + defocus.nbytes
    memory_in_use += defocus.nbytes if keep and overwrite else 0
    memory_in_use += 0 if overwrite else image.nbytes + defocus.nbytes
    memory_in_use += 0 if scene.alpha is None else 2 * defocus.nbytes
    return memory_in_use + (0 if scene.known is None else scene.known.nbytes)


def _report(scene: FocusedScene, engine: Engine, largest_blur: float) -> RenderReport:
    focused = scene.lens
    ranged = focused if focused is not None and focused.near != focused.far else None
    return RenderReport(
        engine=engine.name,
        largest_blur=largest_blur,
        repaired=scene.repaired,
        repair_reason=scene.repair_reason,
        focus_disparity=None if focused is None else focused.near,
        focus_distance=None if focused is None else focused.distance,
        focus_far_disparity=None if ranged is None else ranged.far,
        focus_far_distance=None if ranged is None else ranged.far_distance,
        pixel_filter=scene.pixel_filter if engine.name in RAY_ENGINES else None,
        notes=scene.notes,
        assumptions=scene.assumptions,
        light=scene.light,
    )


def _expects_error(settings: RenderSettings, engine: Engine, lens_response: LensResponse) -> bool:
    """Return whether to estimate errors: if requested, or together with other maps where possible."""
    output = settings.output
    if output.expected_error is not None:
        return output.expected_error == "on"
    return output.save_maps is not None and supports_expected_error(
        engine.classical_name, lens_response, settings.highlights.gamma
    )


def tilt_parameter(settings: RenderSettings) -> dict[str, str]:
    """Return the setting that tilts the plane of focus, for messages about its tilt.

    Examples:
        >>> tilt_parameter(RenderSettings().updated({"focus": {"tilt_x": 5}}))
        {'tilt': 'focus.tilt_x'}
    """
    focus = settings.focus
    if focus.plane is not None:
        return {"tilt": "focus.plane"}
    tilted = next((name for name in ("tilt_x", "tilt_y") if getattr(focus, name)), None)
    return {} if tilted is None else {"tilt": f"focus.{tilted}"}


def _spread_coverage(
    scene: FocusedScene, defocus: Array, engine: Engine, options: RenderOptions
) -> Array | None:
    """Spread the coverage (H, W) of a scene, if any, as the engine spreads the light of a grey picture."""
    alpha, known = scene.alpha, scene.known
    if alpha is None:
        return None
    grey = np.repeat(alpha[..., None], 3, axis=-1)
    in_use = memory.PROGRAM + alpha.nbytes + 2 * defocus.nbytes + 2 * grey.nbytes + scene.image.nbytes
    options = replace(options, known=known and known.without_colors(), memory_in_use=in_use)
    spread = engine.render(grey, defocus, options=options).bokeh
    coverage: Array = np.clip(spread.mean(axis=-1), 0, 1)
    return coverage


def _with_effects(
    bokeh: Array, alpha: Array | None, effects: CameraEffects | None, scene: FocusedScene
) -> tuple[Array, Array | None]:
    """Return light (H, W, 3), premultiplied if there is alpha, and coverage (H, W), with camera effects."""
    if effects is None:
        return bokeh, alpha
    picture = bokeh if alpha is None else np.dstack([bokeh, alpha])
    with errors_named_as("effects", {"distortion": "brown"}):  # the division model never folds
        exposed = effects.apply(picture, view=scene.window.viewport, frame=scene.number)
    return exposed[..., :3], None if alpha is None else exposed[..., 3]

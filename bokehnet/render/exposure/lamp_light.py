"""Diffraction, ghosts and glare of the lamps of a picture, according to the settings."""

import numpy as np
import numpy.typing as npt

from bokehnet.effects.diffracted_lamps import add_rings, add_stars
from bokehnet.effects.ghosts import Ghosts
from bokehnet.effects.glare import Glare
from bokehnet.effects.lamps import Lamps, find_lamps
from bokehnet.io.window import Window
from bokehnet.optics.aperture import Aperture
from bokehnet.render.look import make_highlights
from bokehnet.scene.focus import FocusedLens
from bokehnet.scene.prescription import lens_of_picture
from bokehnet.settings.settings import RenderSettings

__all__ = ["add_lamp_light", "lamps_of"]

Array = npt.NDArray[np.float32]

# Default width of the sensor, mm.
_DEFAULT_SENSOR_WIDTH = 36.0


def lamps_of(image: Array, defocus: Array, settings: RenderSettings) -> Lamps | None:
    """Return the lamps of a picture before the blur; None if no setting uses them.

    Args:
        image: Picture, scene-linear, (H, W, 3).
        defocus: Signed blur radius, pixels, (H, W).
        settings: Settings of the render.

    Examples:
        >>> image, defocus = np.zeros((4, 5, 3), np.float32), np.zeros((4, 5), np.float32)
        >>> image[1, 2] = 3
        >>> lamps = lamps_of(image, defocus, RenderSettings().updated({"light": {"starburst": 16}}))
        >>> len(lamps), lamps_of(image, defocus, RenderSettings())
        (1, None)
    """
    light = settings.light
    if not (light.rings or light.starburst or light.ghosts):
        return None
    highlights = make_highlights(settings.highlights)
    return find_lamps(image if highlights is None else highlights.expand(image), defocus, light.lamps)


def add_lamp_light(
    bokeh: Array,
    lamps: Lamps | None,
    defocus: Array | None,
    aperture: Aperture,
    settings: RenderSettings,
    lens: FocusedLens | None,
    window: Window,
) -> Array:
    """Return the blurred picture with rings, stars, ghosts and glare; the picture itself without any.

    Args:
        bokeh: Blurred picture, scene-linear, (H, W, 3).
        lamps: Result of :func:`lamps_of`, in pixels of ``bokeh``.
        defocus: Signed blur radius, pixels, (H, W); needed with lamps.
        aperture: Aperture of the lens.
        settings: Settings of the render.
        lens: Camera with its focus.
        window: Position of the pixels in the shown picture.

    Examples:
        >>> window, flat = Window.whole(5, 4), np.ones((4, 5, 3), np.float32)
        >>> add_lamp_light(flat, None, None, Aperture(), RenderSettings(), None, window) is flat
        True
    """
    light = settings.light
    if lamps is not None and len(lamps) and defocus is not None:
        camera = None if lens is None else lens.camera
        sensor_width = _DEFAULT_SENSOR_WIDTH if camera is None else camera.sensor_width
        pitch = light.pixel_pitch or 1000 * sensor_width / window.display_width
        if light.rings:
            bokeh = add_rings(bokeh, lamps, defocus, aperture, light.rings / pitch)
        if light.starburst:
            bokeh = add_stars(bokeh, lamps, aperture, light.starburst / pitch)
        if light.ghosts and lens is not None and (glass := lens_of_picture(settings.lens, lens, window)):
            prescription, half_diagonal = glass
            image_radius = prescription.prescription.image_radius if half_diagonal is None else half_diagonal
            ghosts = Ghosts(lens=prescription, half_diagonal=image_radius, coating=light.ghosts)
            bokeh = bokeh + ghosts.light(lamps, *bokeh.shape[:2]).astype(bokeh.dtype)
    if light.glare:
        core = {} if light.glare_core is None else {"core": light.glare_core}
        slope = {} if light.glare_slope is None else {"slope": light.glare_slope}
        half_diagonal_px = 0.5 * float(np.hypot(window.display_width, window.display_height))
        bokeh = Glare(share=light.glare, **core, **slope).apply(bokeh, half_diagonal_px)
    return bokeh

"""What a rendering takes of the memory, known before any pixel is read."""

import math
from dataclasses import replace
from pathlib import Path

from bokehnet.classical.base import Place
from bokehnet.depth_repair.repair import network_memory
from bokehnet.engine_registry import DEFAULT_ENGINE, ENGINES
from bokehnet.engines.coarse_to_fine import ARNET_BYTES, MIN_NETWORK_PIXELS
from bokehnet.engines.engine import ray_reach
from bokehnet.engines.strips import min_strip_rows
from bokehnet.errors import ParameterError
from bokehnet.io.formats.heif import is_heif
from bokehnet.io.picture import find_picture
from bokehnet.io.pixels import ImageFile
from bokehnet.io.window import Window
from bokehnet.render.look import make_lens_response, picture_aberrations
from bokehnet.scene.focus import FocusedLens
from bokehnet.settings.settings import RenderSettings

__all__ = ["PROGRAM", "check_memory", "least_memory"]

# Bytes that the program takes beside its pictures: libraries, kernels, their compiler where no cache holds
# them yet, buffers of the decoders, images of lights.
PROGRAM = 640 * 2**20

# Those of them that only rendering takes.
_RENDERING = 400 * 2**20

# Bytes of a pixel of the whole picture: light and map; and what is held beside them at most while they are
# read, repaired or turned into defocus.
_HELD, _READ, _REPAIRED, _FOCUSED = 16, 5, 14, 12

# What is held of the expected error.
_TOLD = 4

# The same of alpha: it and what is known of its edges beside the picture as it is rendered, and beside itself
# as a grey picture that is rendered first.
_ALPHA, _GREY = 10, 34


def least_memory(settings: RenderSettings, engine: str, width: int, height: int, alpha: bool = False) -> int:
    """Bytes that the program takes at the least for a picture of that size, about.

    Args:
        settings: All that is asked for. Where they do not tell the largest blur, it is taken to be small.
        engine: What renders.
        width: Of the picture.
        height: Of the picture.
        alpha: Whether it has one.

    Examples:
        >>> small, large = (least_memory(RenderSettings(), "hybrid", n, n) for n in (400, 4000))
        >>> large > small
        True
    """
    spec = ENGINES.get(engine)
    if spec is None or not spec.in_strips:
        able = ", ".join(name for name, other in ENGINES.items() if other.in_strips)
        raise ParameterError(
            "engine.max_memory", f"an engine that works in strips: {able}", shown=f"`{engine}`"
        )
    pixels = width * height
    started = max(0, PROGRAM - _RENDERING)
    stages = [started + (_HELD + max(_READ, _FOCUSED)) * pixels]
    if settings.depth.repair != "off" and settings.input.defocus is None:
        stages.append(started + (_HELD + _REPAIRED) * pixels + network_memory(height, width))
    reads_defocus_again = spec.networks is not None and spec.sharp_foregrounds
    held = _HELD + (4 if settings.output.save_maps is not None or reads_defocus_again else 0)
    asked = settings.output.expected_error
    tells = asked == "on" or (asked is None and settings.output.save_maps is not None)
    held += _TOLD if tells and spec.traces_rays else 0
    radius = _least_radius(settings)
    reach = _reach(settings, radius, height, width) if radius and spec.traces_rays else radius
    rows = min_strip_rows(height, reach, spec.classical)
    held += _ALPHA if alpha else 0
    stages.append(PROGRAM + held * pixels + rows * width * spec.bytes_per_pixel)
    if alpha:
        stages.append(PROGRAM + (_HELD + _GREY) * pixels + rows * width * spec.bytes_per_pixel)
    if spec.networks is not None:
        stages.append(PROGRAM + held * pixels + ARNET_BYTES * min(pixels, MIN_NETWORK_PIXELS))
    return max(stages)


def check_memory(path: Path | str, settings: RenderSettings) -> None:
    """Raise unless a picture can be rendered within ``engine.max_memory``; its header alone is read.

    Raises:
        ParameterError: The bound is too small; what it takes is told.
        ImageFileError: The file cannot be read.

    Examples:
        >>> check_memory("no/such/photo.jpg", RenderSettings())  # nothing is bounded, nothing is read
    """
    bound = settings.engine.max_memory
    if bound is None or is_heif(path):
        return
    with ImageFile(path) as file:
        part = find_picture(file).part
    width, height = (part.height, part.width) if part.orientation >= 5 else (part.width, part.height)
    least = least_memory(
        settings, settings.engine.name or DEFAULT_ENGINE, width, height, part.alpha is not None
    )
    if bound < least:
        raise ParameterError(
            "engine.max_memory",
            f"at least {math.ceil(least / 1e6)} MB for {width}x{height} pixels",
            bound,
            shown=f"{bound / 1e6:.0f} MB",
        )


def _reach(settings: RenderSettings, radius: int, height: int, width: int) -> int:
    """Pixels within which rays stay behind the lens of the settings, where disparity is relative."""
    response = make_lens_response(settings.lens, settings.color)
    window = Window.whole(width, height)
    focused = FocusedLens(near=0.0, far=0.0, blur=1.0, camera=None, plane=None, window=window)
    glass = picture_aberrations(settings.lens, focused, window)
    if glass is not None:
        response = replace(response, aberration_map=response.aberration_map + glass)
    return max(radius, ray_reach(response, Place.whole(height, width), radius))


def _least_radius(settings: RenderSettings) -> int:
    """Largest blur radius that a map from 0 to 1 has, pixels; 0 where it cannot be told."""
    focus, depth, blur = settings.focus, settings.depth, settings.camera.blur
    leans = focus.plane is not None or focus.tilt_x or focus.tilt_y
    own_range = depth.as_stored or depth.value_range is not None or settings.input.disparity is None
    if blur is None or focus.value is None or focus.range is not None or leans or own_range:
        return 0
    return math.ceil(blur * max(abs(focus.value), abs(1 - focus.value)))

"""Memory bounds of a render, checked before reading pixels."""

import math
from dataclasses import replace
from pathlib import Path

from bokehnet.arrays.viewport import Viewport
from bokehnet.engine_registry import DEFAULT_ENGINE, ENGINES
from bokehnet.engines.coarse_to_fine import ARNET_BYTES, MIN_NETWORK_PIXELS
from bokehnet.engines.engine import ray_reach
from bokehnet.engines.strips import min_strip_bytes
from bokehnet.errors import ParameterError
from bokehnet.io.formats.heif import heif_size, is_heif
from bokehnet.io.pixels import ImageFile
from bokehnet.io.selection.picture import find_picture
from bokehnet.io.window import Window
from bokehnet.render.look import make_lens_response, picture_aberrations
from bokehnet.scene.focus import FocusedLens
from bokehnet.settings.settings import RenderSettings

__all__ = ["PROGRAM", "check_memory", "min_memory"]

# Memory of the program without pictures, bytes: libraries, kernels, their compiler if no cache has them yet,
# buffers of decoders, images of lights.
PROGRAM = 640 * 2**20

# Part of it that only rendering needs, bytes.
_RENDERING = 400 * 2**20

# Bytes per pixel of the whole picture: light and map, and in addition while reading, repairing and focusing.
_HEIF_BYTES = 24  # of the decoder and its result
_PICTURE_BYTES, _READ_BYTES, _REPAIR_BYTES, _FOCUS_BYTES = 16, 5, 21, 12

# Bytes per pixel of the size at which the stages of the repair run, and maximum number of these pixels.
_STAGES_BYTES, _MAX_STAGES_PIXELS = 64, 2**20

# Bytes per pixel of the expected error.
_EXPECTED_ERROR_BYTES = 4

# Bytes per pixel of alpha and its known edges while rendering the picture, and while rendering alpha itself
# as a grey picture before.
_ALPHA_BYTES, _GREY_BYTES = 10, 34


def min_memory(settings: RenderSettings, engine: str, width: int, height: int, alpha: bool = False) -> int:
    """Return the approximate minimum memory in bytes to render a picture of this size.

    Args:
        settings: Settings of the render. If the largest blur does not follow from them, it counts as small.
        engine: Name of the engine.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
        alpha: True if the picture has alpha.

    Examples:
        >>> small, large = (min_memory(RenderSettings(), "hybrid", n, n) for n in (400, 4000))
        >>> large > small
        True
    """
    spec = ENGINES.get(engine)
    if spec is None or not spec.in_strips:
        names = ", ".join(name for name, other in ENGINES.items() if other.in_strips)
        raise ParameterError(
            "engine.max_memory", f"an engine that works in strips: {names}", shown=f"`{engine}`"
        )
    pixels = width * height
    program = max(0, PROGRAM - _RENDERING)
    stages = [program + (_PICTURE_BYTES + max(_READ_BYTES, _FOCUS_BYTES)) * pixels]
    if settings.depth.repair != "off" and settings.input.defocus is None:
        small = _STAGES_BYTES * min(pixels, _MAX_STAGES_PIXELS)
        stages.append(program + (_PICTURE_BYTES + _REPAIR_BYTES) * pixels + small)
    reads_defocus_again = spec.networks is not None and spec.sharp_foregrounds
    per_pixel = _PICTURE_BYTES + (4 if settings.output.save_maps is not None or reads_defocus_again else 0)
    expected_error = settings.output.expected_error
    estimates = expected_error == "on" or (expected_error is None and settings.output.save_maps is not None)
    per_pixel += _EXPECTED_ERROR_BYTES if estimates and spec.traces_rays else 0
    radius = _largest_relative_blur(settings)
    halo = _ray_reach(settings, radius, height, width) if radius and spec.traces_rays else radius
    bands = spec.networks is None and not (estimates and spec.traces_rays)
    strip = min_strip_bytes((height, width), halo, spec.classical, bands)
    per_pixel += _ALPHA_BYTES if alpha else 0
    stages.append(PROGRAM + per_pixel * pixels + strip)
    if alpha:
        stages.append(PROGRAM + (_PICTURE_BYTES + _GREY_BYTES) * pixels + strip)
    if spec.networks is not None:
        stages.append(PROGRAM + per_pixel * pixels + ARNET_BYTES * min(pixels, MIN_NETWORK_PIXELS))
    return max(stages)


def check_memory(path: Path | str, settings: RenderSettings) -> None:
    """Raise unless a picture and its map can be read and rendered within ``engine.max_memory``.

    Reads only headers.

    Raises:
        ParameterError: The bound is too small; the message contains the minimum.
        ImageFileError: The file cannot be read.

    Examples:
        >>> check_memory("no/such/photo.jpg", RenderSettings())  # no bound, no reading
    """
    bound = settings.engine.max_memory
    if bound is None:
        return
    alpha, reading = False, 0
    if is_heif(path):  # decoded at once
        height, width = heif_size(path)
        reading = _HEIF_BYTES * height * width
    else:
        with ImageFile(path) as file:
            part = find_picture(file).part
            reading = file.reading_bytes(part)
        width, height = (part.height, part.width) if part.orientation >= 5 else (part.width, part.height)
        alpha = part.alpha is not None
    engine, pixels = settings.engine.name or DEFAULT_ENGINE, width * height
    program = max(0, PROGRAM - _RENDERING)
    _check_bound(bound, min_memory(settings, engine, width, height, alpha), f"{width}x{height} pixels")
    _check_bound(bound, program + _PICTURE_BYTES * pixels + reading, f"reading {path}")
    inputs = settings.input
    for source in (inputs.disparity, inputs.depth, inputs.defocus):
        if source is None or is_heif(source) or not Path(source).is_file():
            continue
        with ImageFile(source) as file:
            size = max(part.width * part.height for part in file.parts)
            reading = max(map(file.reading_bytes, file.parts))
        _check_bound(bound, program + _PICTURE_BYTES * (pixels + size) + reading, f"reading {source}")


def _check_bound(bound: int, minimum: int, purpose: str) -> None:
    """Raise if the bound is below the minimum for this purpose."""
    if bound < minimum:
        raise ParameterError(
            "engine.max_memory",
            f"at least {math.ceil(minimum / 1e6)} MB for {purpose}",
            bound,
            shown=f"{bound / 1e6:.0f} MB",
        )


def _ray_reach(settings: RenderSettings, radius: int, height: int, width: int) -> int:
    """Return the maximum offset of rays in pixels behind the lens of the settings, for relative disparity."""
    response = make_lens_response(settings.lens, settings.color)
    window = Window.whole(width, height)
    focused = FocusedLens(near=0.0, far=0.0, blur=1.0, camera=None, plane=None, window=window)
    glass = picture_aberrations(settings.lens, focused, window)
    if glass is not None:
        response = replace(response, aberration_map=response.aberration_map + glass)
    return max(radius, ray_reach(response, Viewport.whole(height, width), radius))


def _largest_relative_blur(settings: RenderSettings) -> int:
    """Return the largest blur radius of a map from 0 to 1, pixels; 0 if it is unknown."""
    focus, depth, blur = settings.focus, settings.depth, settings.camera.blur
    tilted = focus.plane is not None or focus.tilt_x or focus.tilt_y
    own_range = depth.value_range is not None or settings.input.disparity is None
    if blur is None or focus.value is None or focus.range is not None or tilted or own_range:
        return 0
    return math.ceil(blur * max(abs(focus.value), abs(1 - focus.value)))

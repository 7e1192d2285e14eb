"""Expected time of renders with very large blur, and the question whether to go on."""

import math
import os
import sys

import click

from bokehnet.cli.progress import write_above
from bokehnet.engine_registry import DEFAULT_ENGINE
from bokehnet.scene.scene import Scene
from bokehnet.settings.settings import RenderSettings

__all__ = ["confirm_large_blur", "expected_seconds", "is_large_blur", "large_blur_notice"]

# Blur radius, relative to the width, and time, s, above which a render is worth a question.
_LARGE_BLUR, _LONG_SECONDS = 0.15, 10.0

# Blur radius that no renderer accepts, pixels.
_MAX_RADIUS = 1e9

# Processor time per pixel, s, without blur and per pixel of blur radius; measured on photographs of 0.2 and
# 0.6 megapixels with radii of 2 % to 1400 % of the width.
_PIXEL_SECONDS = {"scatter": (1e-7, 3e-9), "rays": (1.5e-6, 1e-7)}


def confirm_large_blur(settings: RenderSettings, width: int, height: int, radius: float) -> None:
    """Print the expected time of a very large blur; ask on a terminal whether to go on if it is long.

    Args:
        settings: Settings of the render.
        width: Width of the result, pixels.
        height: Height of the result, pixels.
        radius: Largest blur radius, pixels.

    Raises:
        click.exceptions.Exit: The user declines.
    """
    engine = settings.engine.name or DEFAULT_ENGINE
    notice = large_blur_notice(engine, width, height, radius)
    if not notice:
        return
    write_above(notice)
    is_long = expected_seconds(engine, width, height, radius) > _LONG_SECONDS
    if is_long and sys.stdin.isatty() and sys.stderr.isatty():
        if click.confirm("Continue?", err=True, default=True):
            return
        click.echo("bokehnet: nothing rendered; a smaller --blur takes less time", err=True)
        raise click.exceptions.Exit(1)


def is_large_blur(settings: RenderSettings, scene: Scene) -> bool:
    """Return True if the requested blur exceeds 15 % of the width, which is known before the depth repair.

    The largest blur radius of a tilted plane of focus is not: the engine may refuse its slope.
    """
    focus, width = settings.focus, scene.image.shape[1] // scene.supersampled
    is_tilted = focus.plane is not None or focus.tilt_x != 0 or focus.tilt_y != 0
    return not is_tilted and (settings.camera.blur or 0.0) > _LARGE_BLUR * width


def expected_seconds(engine: str, width: int, height: int, radius: float) -> float:
    """Return the expected time of a render on this machine, s, within a factor of about two.

    Args:
        engine: Name of the engine.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
        radius: Largest blur radius, pixels; beyond the longer side it costs nothing more.

    Examples:
        >>> expected_seconds("rays", 1000, 1000, 500) > 10 * expected_seconds("scatter", 1000, 1000, 500)
        True
    """
    constant, per_radius = _PIXEL_SECONDS["scatter" if engine == "scatter" else "rays"]
    seconds = width * height * (constant + per_radius * min(radius, max(width, height)))
    return seconds / (os.cpu_count() or 1)


def large_blur_notice(engine: str, width: int, height: int, radius: float) -> str:
    """Return a line with the expected time of a render whose blur exceeds 15 % of the width; else nothing.

    Args:
        engine: Name of the engine.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
        radius: Largest blur radius, pixels.

    Examples:
        >>> large_blur_notice("scatter", 1000, 1000, 100)
        ''
    """
    if not _LARGE_BLUR * width < radius < _MAX_RADIUS:
        return ""
    seconds = expected_seconds(engine, width, height, radius)
    time = f"{max(seconds, 1):.0f} s" if seconds < 90 else f"{math.ceil(seconds / 60)} minutes"
    share = f"{100 * radius / width:.0f} % of the width"
    return f"bokehnet: note: blur up to {radius:.0f} px, {share}: expect about {time}"

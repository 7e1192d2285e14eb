"""Expected time of renders with very large blur, and the question whether to go on."""

import math
import os
import sys

import click

from bokehnet.engine_registry import DEFAULT_ENGINE
from bokehnet.io.window import Window
from bokehnet.settings.settings import RenderSettings

__all__ = ["confirm_set_blur", "expected_seconds", "large_blur_notice", "largest_set_blur"]

# Blur radius, relative to the width, and time, s, above which a render is worth a question.
_LARGE_BLUR, _LONG_SECONDS = 0.15, 10.0

# Blur radius that no renderer accepts, pixels.
_MAX_RADIUS = 1e9

# Processor time per pixel, s, without blur and per pixel of blur radius; measured on photographs of 0.2 and
# 0.6 megapixels with radii of 2 % to 1400 % of the width.
_PIXEL_SECONDS = {"scatter": (1e-7, 3e-9), "rays": (1.5e-6, 1e-7)}


def confirm_set_blur(settings: RenderSettings, window: Window) -> None:
    """Print the expected time of a very large blur that the settings define; ask on a terminal if it is long.

    Args:
        settings: Settings of the render.
        window: Size of the picture.

    Raises:
        click.Abort: The user declines.
    """
    factor, engine = settings.input.supersampled, settings.engine.name or DEFAULT_ENGINE
    width, height = window.display_width // factor, window.display_height // factor
    radius = largest_set_blur(settings)
    notice = large_blur_notice(engine, width, height, radius)
    if not notice:
        return
    click.echo(notice, err=True)
    is_long = expected_seconds(engine, width, height, radius) > _LONG_SECONDS
    if is_long and sys.stdin.isatty() and sys.stderr.isatty():
        click.confirm("Continue?", err=True, default=True, abort=True)


def largest_set_blur(settings: RenderSettings) -> float:
    """Return the largest blur radius that the settings alone allow, pixels; 0 if it depends on the map.

    Examples:
        >>> changes = {"input": {"disparity": "map.png"}, "camera": {"blur": 400}, "focus": {"value": 0.25}}
        >>> largest_set_blur(RenderSettings().updated(changes))
        300.0
    """
    blur, focus = settings.camera.blur, settings.focus
    if blur is None:
        return 0.0
    if focus.value is None or focus.tilt_x or focus.tilt_y:
        return blur
    return blur * max(focus.value, 1 - focus.value)


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
    return f"bokehnet: blur up to {radius:.0f} px, {share}: expect about {time}"

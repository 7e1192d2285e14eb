"""Deprecated call of ``BokehRenderer.render`` with arrays, of version 0.1; version 0.3 removes it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from bokehnet.deprecation import warn_deprecated
from bokehnet.engines.options import RenderOptions, split_option_keywords
from bokehnet.render.result import RenderResult

__all__ = ["render_earlier_form"]


def render_earlier_form(
    render_arrays: Callable[..., RenderResult], arrays: tuple[Any, ...], keywords: dict[str, Any]
) -> RenderResult:
    """Render the arrays that ``render`` received, with a ``DeprecationWarning``.

    Args:
        render_arrays: :meth:`BokehRenderer.render_arrays` of the renderer.
        arrays: Its positional arguments; None for absent ones.
        keywords: Its keywords, and fields of ``RenderOptions``.

    Raises:
        TypeError: There is no image, or an unknown keyword.

    Examples:
        >>> from bokehnet.render.renderer import BokehRenderer
        >>> picture, defocus = np.ones((24, 32, 3), np.float32), np.full((24, 32), 4, np.float32)
        >>> BokehRenderer("scatter").render(picture, defocus, gamma=2.0).report.largest_blur
        4.0
    """
    image, defocus, progress = arrays
    options, others = split_option_keywords(keywords)
    if not isinstance(image, np.ndarray) and "image" not in others:
        raise TypeError(f"render() got unexpected keyword arguments: {', '.join(keywords)}")
    message = "render arrays with BokehRenderer.render_arrays; version 0.3 removes this form of render"
    warn_deprecated(message, level=2)
    named = {"image": image, "defocus": defocus, "progress": progress}
    others |= {name: value for name, value in named.items() if value is not None}
    return render_arrays(**others, options=RenderOptions(**options))

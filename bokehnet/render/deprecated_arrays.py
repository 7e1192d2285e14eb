"""Deprecated call of ``BokehRenderer.render`` with arrays, of version 0.1; version 0.3 removes it."""

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec

import numpy as np

from bokehnet.deprecation import warn_deprecated
from bokehnet.engines.options import RenderOptions, split_option_keywords
from bokehnet.render.result import RenderResult

__all__ = ["accepts_arrays"]

Parameters = ParamSpec("Parameters")


def accepts_arrays(render: Callable[Parameters, RenderResult]) -> Callable[Parameters, RenderResult]:
    """Let ``render`` accept the arrays and keywords of ``render_arrays``, with a ``DeprecationWarning``.

    Examples:
        >>> from bokehnet.render.renderer import BokehRenderer
        >>> picture, defocus = np.ones((24, 32, 3), np.float32), np.full((24, 32), 4, np.float32)
        >>> BokehRenderer("scatter").render(picture, defocus, gamma=2.0).report.largest_blur
        4.0
    """

    @wraps(render)
    def with_arrays(*args: Any, **keywords: Any) -> RenderResult:
        if "image" not in keywords and not (len(args) > 1 and isinstance(args[1], np.ndarray)):
            return render(*args, **keywords)
        message = "render arrays with BokehRenderer.render_arrays; version 0.3 removes this form of render"
        warn_deprecated(message)
        renderer, *arrays = args
        options, others = split_option_keywords(keywords)
        result: RenderResult = renderer.render_arrays(*arrays, **others, options=RenderOptions(**options))
        return result

    return with_arrays  # type: ignore[return-value]  # type checkers see the signature for scenes

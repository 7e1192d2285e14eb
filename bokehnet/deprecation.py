"""Earlier names of keywords, which work with a ``DeprecationWarning``."""

import warnings
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

__all__ = ["renamed_keywords"]

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def renamed_keywords(
    **new_names: str,
) -> Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Return a decorator that accepts the earlier names of keywords, deprecated since version 0.2.

    Args:
        new_names: Present name of each earlier name.

    Examples:
        >>> @renamed_keywords(width="radius")
        ... def double(radius):
        ...     return 2 * radius
        >>> double(width=3)
        6
    """

    def decorate(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
        @wraps(function)
        def with_earlier_names(*args: Any, **keywords: Any) -> Result:
            for name in new_names.keys() & keywords.keys():
                message = f"use {new_names[name]}= instead of {name}=; version 0.3 removes it"
                warnings.warn(message, DeprecationWarning, stacklevel=2)
                keywords.setdefault(new_names[name], keywords.pop(name))
            return function(*args, **keywords)

        return with_earlier_names  # type: ignore[return-value]  # earlier names are not in the signature

    return decorate

"""Earlier names of public attributes and keywords, which work with a ``DeprecationWarning``."""

import warnings
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

__all__ = ["earlier_name", "renamed_keywords"]

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


def earlier_name(old: str, new: str) -> Any:
    """Return a property that warns and gives the attribute or method under its present name.

    Args:
        old: Earlier name, which the property is assigned to.
        new: Present name.

    Examples:
        >>> class Lens:
        ...     min_f_number = 1.4
        ...     fastest = earlier_name("fastest", "min_f_number")
        >>> Lens().fastest
        1.4
    """

    def get(self: Any) -> Any:
        message = f"{type(self).__name__}.{old} is now {new}"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return getattr(self, new)

    return property(get, doc=f"Earlier name of ``{new}``.")

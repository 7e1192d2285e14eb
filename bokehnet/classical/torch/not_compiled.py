"""Decorator that excludes functions from ``torch.compile``."""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import torch

__all__ = ["not_compiled"]

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def not_compiled(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Return a function that ``torch.compile`` does not trace, like ``torch.compiler.disable``.

    Importing ``torch.compiler.disable`` takes a second; only compiled programs import it.

    Examples:
        >>> @not_compiled
        ... def double(values):
        ...     return torch.from_numpy(2 * values.numpy())
        >>> double(torch.ones(2))
        tensor([2., 2.])
    """

    @functools.wraps(function)
    def call(*values: Arguments.args, **named: Arguments.kwargs) -> Result:
        if torch.compiler.is_compiling():
            return torch.compiler.disable(function)(*values, **named)
        return function(*values, **named)

    return call

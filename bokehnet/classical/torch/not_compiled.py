"""Functions that a compiler of torch programs is to leave as they are."""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import torch

__all__ = ["not_compiled"]

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def not_compiled(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorate as ``torch.compiler.disable`` does, which is imported (a second) by compiled programs alone.

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

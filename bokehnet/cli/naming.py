"""Errors of the library in the words of the command line."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from bokehnet.errors import ParameterError

__all__ = ["named_options"]


@contextmanager
def named_options(options: Mapping[str, str]) -> Iterator[None]:
    """Let a ``ParameterError`` about a parameter name the option that set it.

    Args:
        options: Parameter, as its error begins, to option.
    """
    try:
        yield
    except ParameterError as error:
        parameter, colon, reason = str(error).partition(":")
        if parameter not in options:
            raise
        raise ParameterError(f"{options[parameter]}{colon}{reason}") from error

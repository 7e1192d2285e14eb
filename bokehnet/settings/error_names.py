"""Errors of the rooms below in the words of the settings."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from bokehnet.errors import ParameterError
from bokehnet.settings.settings import all_settings

__all__ = ["about"]


@contextmanager
def about(group: str, names: Mapping[str, str] | None = None) -> Iterator[None]:
    """Let a ``ParameterError`` of a room below name the field of the settings.

    Args:
        group: Of the settings.
        names: Parameter to field, where they differ.

    Examples:
        >>> with about("aperture", {"picture": "image"}):
        ...     raise ParameterError("picture", expected="some light", shown="none")
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: aperture.image: expected some light, got none
    """
    try:
        yield
    except ParameterError as error:
        field = (names or {}).get(error.parameter, error.parameter)
        path = field if "." in field else f"{group}.{field}"
        if path not in all_settings():
            raise
        raise error.renamed(path) from error

"""Errors of lower layers, renamed to fields of the settings."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from bokehnet.errors import ParameterError
from bokehnet.settings.settings import all_settings

__all__ = ["errors_named_as"]


@contextmanager
def errors_named_as(group: str, names: Mapping[str, str] | None = None) -> Iterator[None]:
    """Rename a ``ParameterError`` of a lower layer to a field of the settings.

    Args:
        group: Group of the settings.
        names: Parameter name to field name, where they differ.

    Examples:
        >>> with errors_named_as("aperture", {"picture": "image"}):
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

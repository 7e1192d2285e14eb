"""Messages of failed work: the user's errors in their own words, bugs with their traceback on stderr."""

import traceback

from bokehnet.errors import BokehnetError

__all__ = ["failure_message"]


def failure_message(error: Exception) -> str:
    """Return the message of an error; one line for a bug, whose traceback is printed to stderr.

    Examples:
        >>> failure_message(BokehnetError("expected a picture"))
        'expected a picture'
    """
    if isinstance(error, BokehnetError):
        return str(error)
    traceback.print_exception(error)
    return " ".join(f"internal error: {type(error).__name__}: {error}".split())

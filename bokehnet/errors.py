"""Exceptions of bokehnet.

::

    BokehnetError
    |-- ShapeError         (ValueError)   an array has the wrong rank or size
    |-- ParameterError     (ValueError)   a number or a choice is out of range, or of the wrong type;
    |                                     has parameter, expected, got and remedy
    |-- LensError          (ValueError)   a lens is invalid or cannot focus there; may have parameter
    |-- ConfigError        (ValueError)   a configuration file has a wrong key or value
    |-- ImageFileError     (OSError)      an image cannot be read or written
    |-- RenderCancelled                   the caller cancelled the render
    |-- DataFileError      (OSError)      a shard or a checkpoint cannot be used
    |-- ModelFileError     (OSError)      network weights are missing, damaged or of another version
    `-- MissingExtraError  (ImportError)  an optional dependency is not installed

Every message names the parameter, the expected and the actual value, and a remedy. The command line prints
it as one line; any other exception is a bug and keeps its traceback.

``expected`` and ``remedy`` put other parameters in back quotes, as in "give `blur`", by their Python names.
The command line and the studio replace these by their own names when they show the message.
"""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from enum import Enum
from numbers import Integral, Real
from os import PathLike
from typing import Any, Self

__all__ = [
    "BokehnetError",
    "ConfigError",
    "DataFileError",
    "ErrorCollector",
    "ImageFileError",
    "LensError",
    "MissingExtraError",
    "ModelFileError",
    "ParameterError",
    "RenderCancelled",
    "ShapeError",
    "errors_of_file",
]


class _Nothing(Enum):
    """Sentinel for a missing value, as None can be a value."""

    NOTHING = "nothing"


_NOTHING = _Nothing.NOTHING

# Maximum numbers of characters of a value and of the reason of another library in a message.
_MAX_VALUE_CHARACTERS, _MAX_REASON_CHARACTERS = 100, 300

# Parameter name at the start of a message in a single text: focus.blur, quads[0].radius, or an option.
_NAME = re.compile(r"(?:--)?[A-Za-z_][\w-]*(?:\.[A-Za-z_]\w*|\[\d+\])*")


class BokehnetError(Exception):
    """Base of all errors that the caller can correct.

    Its text is one line: line breaks become spaces, other control characters (as in damaged files) are
    escaped.
    """

    def __str__(self) -> str:
        text = super().__str__()
        if text.isprintable():
            return text
        return "".join(c if c.isprintable() else repr(c)[1:-1] for c in " ".join(text.split()))


class ShapeError(BokehnetError, ValueError):
    """An array has the wrong rank or size."""


class ParameterError(BokehnetError, ValueError):
    """A number or a choice is out of range, or of the wrong type.

    The message is ``{parameter}: expected {expected}, got {got}; {remedy}``, without the empty parts. A
    single argument is a whole message: a name before its first colon becomes ``parameter``.

    Pickling keeps numbers, texts and tuples of them as ``got``, and the text of any other value.

    Args:
        parameter: Name of the argument or field, as in Python: "curvature".
        expected: Accepted values, without the word "expected": "0 to 1".
        got: Rejected value itself; None counts as a value.
        remedy: Remedy where ``expected`` does not imply it, such as "give `blur`".
        shown: Text of ``got`` in the message, such as one with a unit. Default: short floats, texts in
            quotes. Without ``got``: a description of the input, such as "3 that are NaN".

    Attributes:
        parameter: Name of the parameter; empty if a whole message names none.
        expected: Accepted values.
        got: Rejected value, or the text ``shown`` without one; undefined if not :attr:`has_got`.
        remedy: Remedy, or empty.
    """

    parameter: str
    expected: str
    got: object
    remedy: str

    def __init__(
        self,
        parameter: str,
        expected: str = "",
        got: object = _NOTHING,
        remedy: str = "",
        *,
        shown: str | None = None,
    ) -> None:
        self.parameter, self.expected, self.remedy = parameter, expected, remedy
        self.got = shown if got is _NOTHING and shown is not None else got
        actual = f"got {_value_text(got) if shown is None else shown}" if self.has_got else ""
        mismatch = ", ".join(filter(None, [expected and f"expected {expected}", actual]))
        self._reason = "; ".join(filter(None, [mismatch, remedy]))
        if not self._reason:
            name, _, rest = parameter.partition(":")
            has_name = bool(rest) and _NAME.fullmatch(name) is not None
            self.parameter, self._reason = (name, rest.lstrip()) if has_name else ("", parameter)
        super().__init__(self._message())

    @property
    def has_got(self) -> bool:
        """True if ``got`` is set."""
        return self.got is not _NOTHING

    def renamed(self, parameter: str) -> Self:
        """Return the same error with another parameter name, as used by a higher layer."""
        copied = self.__copy__()
        copied.parameter = parameter
        copied.args = (copied._message(),)
        return copied

    def with_others(self, others: Iterable["ParameterError"]) -> Self:
        """Return the same error with the messages of other parameters at its end."""
        copied = self.__copy__()
        reasons = [f"`{other.parameter}`: {other._reason}" for other in others]
        copied._reason = "; ".join([self._reason, *reasons])
        copied.args = (copied._message(),)
        return copied

    def _message(self) -> str:
        return ": ".join(filter(None, [self.parameter, self._reason]))

    def __copy__(self) -> Self:
        copied = _bare(type(self), str(self))
        copied.__dict__.update(self.__dict__)
        return copied

    def __reduce__(self) -> tuple[Any, ...]:
        return _bare, (type(self), str(self)), {**self.__dict__, "got": _portable(self.got)}


class ErrorCollector:
    """Collector of the errors of several parameters, for one message about all of them.

    Examples:
        >>> errors = ErrorCollector()
        >>> for name in ("blur", "focus"):
        ...     with errors.collect():
        ...         raise ParameterError(name, expected="one", shown="none")
        >>> errors.raise_all()
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: blur: expected one, got none; `focus`: expected one, got none
    """

    def __init__(self) -> None:
        self._errors: list[ParameterError] = []

    @contextmanager
    def collect(self) -> Iterator[None]:
        """Keep a ``ParameterError`` of the block."""
        try:
            yield
        except ParameterError as error:
            self._errors.append(error)

    def add(self, errors: Iterable[ParameterError]) -> None:
        """Keep errors that were not raised."""
        self._errors += errors

    def raise_all(self) -> None:
        """Raise the errors as one, if there are any; the first one has the attributes."""
        if self._errors:
            first, *others = self._errors
            raise first.with_others(others) if others else first


class LensError(BokehnetError, ValueError):
    """A lens is invalid, or cannot focus at the requested distance.

    Attributes:
        parameter: Name of the invalid field, such as "f_number"; empty if there is none.
    """

    def __init__(self, message: str, parameter: str = "") -> None:
        super().__init__(message)
        self.parameter = parameter


class RenderCancelled(BokehnetError):  # noqa: N818  # no error of the caller
    """The caller cancelled the render."""


class ConfigError(BokehnetError, ValueError):
    """A configuration file has a wrong key or value."""


class ImageFileError(BokehnetError, OSError):
    """An image file cannot be read or written."""


class DataFileError(BokehnetError, OSError):
    """A training shard or a checkpoint cannot be read, written or resumed."""


class ModelFileError(BokehnetError, OSError):
    """Network weights are missing, damaged or of another version."""


class MissingExtraError(BokehnetError, ImportError):
    """An optional dependency is not installed."""


@contextmanager
def errors_of_file(path: str | PathLike[str], expected: str, kind: type[BokehnetError]) -> Iterator[None]:
    """Convert every other exception inside the block into an error of one line that names the file.

    For parsers of files from strangers: whatever they raise follows from the content of the file. Errors of
    this package pass unchanged.

    Args:
        path: File that the block reads.
        expected: Expected content, such as "a video".
        kind: Class of the error.

    Examples:
        >>> with errors_of_file("a.toml", "a lens", LensError):
        ...     int("x" * 0)
        Traceback (most recent call last):
        ...
        bokehnet.errors.LensError: a.toml: expected a lens, found damage (invalid literal for int() ...)
    """
    try:
        yield
    except BokehnetError:
        raise
    except MemoryError as error:
        raise kind(f"{path}: expected {expected}, found one that does not fit into memory") from error
    except OSError as error:
        raise kind(f"cannot read {path}: {error.strerror or error}") from error
    except Exception as error:
        reason = str(error) or type(error).__name__
        shown = reason if len(reason) <= _MAX_REASON_CHARACTERS else f"{reason[:_MAX_REASON_CHARACTERS]}..."
        raise kind(f"{path}: expected {expected}, found damage ({shown})") from error


def _bare(kind: type[Any], message: str) -> Any:
    """Return an error of this class with only its message."""
    return kind.__new__(kind, message)


def _value_text(value: Any) -> str:
    """Return the text of a value in a message: one short line."""
    try:
        text = _text(value)
    except Exception:  # numbers with too many digits, objects whose repr fails
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= _MAX_VALUE_CHARACTERS else f"{text[:_MAX_VALUE_CHARACTERS]}..."


def _text(value: Any) -> str:
    if getattr(value, "ndim", None) == 0:  # NumPy's numbers, tensors
        value = value.item()
    if isinstance(value, Real) and not isinstance(value, Integral):
        return f"{float(value):g}"
    if type(value) in (list, tuple):
        items = ", ".join(map(_value_text, value[:_MAX_VALUE_CHARACTERS]))
        comma = "," if type(value) is tuple and len(value) == 1 else ""
        return f"[{items}]" if type(value) is list else f"({items}{comma})"
    if hasattr(value, "shape"):
        return f"an array of shape {tuple(value.shape)}"
    return " ".join(repr(value).split())


def _portable(value: Any) -> Any:
    """Return the value if any process can unpickle it, else its text."""
    if type(value).__module__ == "numpy" and getattr(value, "ndim", None) == 0:
        value = value.item()
    if value is None or type(value) in (bool, int, float, complex, str, bytes, _Nothing):
        return value
    if type(value) in (list, tuple):
        return type(value)(map(_portable, value))
    return _value_text(value)

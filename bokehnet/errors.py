"""The errors that bokehnet raises on purpose.

::

    BokehnetError
    |-- ShapeError         (ValueError)   an array has the wrong rank or size
    |-- ParameterError     (ValueError)   a number or a choice is out of range, or of the wrong type;
    |                                     has parameter, expected, got and remedy
    |-- LensError          (ValueError)   a lens cannot exist or cannot focus there; may have parameter
    |-- ConfigError        (ValueError)   a configuration file has a wrong key or value
    |-- ImageFileError     (OSError)      an image cannot be read or written
    |-- RenderCancelled                   nobody wants the result any more
    |-- DataFileError      (OSError)      a shard or a checkpoint cannot be used
    |-- ModelFileError     (OSError)      network weights are missing, damaged or of another version
    `-- MissingExtraError  (ImportError)  an optional dependency is not installed

Every message says what was wrong, what was expected, what was found and the way out. The command line
prints it as one line; any other exception is a bug and keeps its traceback.

Other parameters stand in back quotes in ``expected`` and ``remedy``, as "give `blur`", and never with the
names that a command line or a page has for them: these are put in by whoever shows the message.
"""

import re
from enum import Enum
from numbers import Integral, Real
from typing import Any, Self

__all__ = [
    "BokehnetError",
    "ConfigError",
    "DataFileError",
    "ImageFileError",
    "LensError",
    "MissingExtraError",
    "ModelFileError",
    "ParameterError",
    "RenderCancelled",
    "ShapeError",
]


class _Nothing(Enum):
    """What stands where no value is told; None can be one."""

    NOTHING = "nothing"


_NOTHING = _Nothing.NOTHING

# Characters of a value in a message.
_LONGEST = 100

# What begins a message that is all in one text: a parameter, as focus.blur or quads[0].radius, or an option.
_NAME = re.compile(r"(?:--)?[A-Za-z_][\w-]*(?:\.[A-Za-z_]\w*|\[\d+\])*")


class BokehnetError(Exception):
    """Base of every error that is the caller's to mend.

    Its text is one line: where it holds control characters, as names in damaged files do, line breaks become
    spaces and the others are escaped.
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

    The message is ``{parameter}: expected {expected}, got {got}; {remedy}``; what is empty is left out. A
    single argument is a whole message: a name before its first colon becomes ``parameter``.

    It can be pickled. Then numbers, texts and tuples of them come along, of other values the text.

    Args:
        parameter: Name of the argument or field, as in Python: "curvature".
        expected: What it may be, without "expected": "0 to 1".
        got: What it was: the value itself. None is a value, too.
        remedy: The way out where ``expected`` does not tell it, as "give `blur`".
        shown: Text of ``got`` in the message, with its unit, say; by default floats are short and texts in
            quotes. Without ``got`` it is what was found, as "3 that are NaN".

    Attributes:
        parameter: As given; empty if a whole message names none.
        expected: As given.
        got: The value, or else the text of what was found; of no meaning where :attr:`has_got` is not.
        remedy: As given.
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
        found = f"got {_told(got) if shown is None else shown}" if self.has_got else ""
        wanted = ", ".join(filter(None, [expected and f"expected {expected}", found]))
        self._reason = "; ".join(filter(None, [wanted, remedy]))
        if not self._reason:
            name, _, rest = parameter.partition(":")
            named = bool(rest) and _NAME.fullmatch(name) is not None
            self.parameter, self._reason = (name, rest.lstrip()) if named else ("", parameter)
        super().__init__(self._message())

    @property
    def has_got(self) -> bool:
        """Whether ``got`` was told."""
        return self.got is not _NOTHING

    def renamed(self, parameter: str) -> Self:
        """Return the same error about the parameter of another name, for rooms above that have their own."""
        twin = self.__copy__()
        twin.parameter = parameter
        twin.args = (twin._message(),)
        return twin

    def _message(self) -> str:
        return ": ".join(filter(None, [self.parameter, self._reason]))

    def __copy__(self) -> Self:
        twin = _bare(type(self), str(self))
        twin.__dict__.update(self.__dict__)
        return twin

    def __reduce__(self) -> tuple[Any, ...]:
        return _bare, (type(self), str(self)), {**self.__dict__, "got": _portable(self.got)}


class LensError(BokehnetError, ValueError):
    """A lens cannot exist, or cannot focus where it was asked to.

    Attributes:
        parameter: Name of the field that is wrong, where it is one: "f_number". Else empty.
    """

    def __init__(self, message: str, parameter: str = "") -> None:
        super().__init__(message)
        self.parameter = parameter


class RenderCancelled(BokehnetError):  # noqa: N818  # it is no mistake
    """A rendering ended because it was cancelled."""


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


def _bare(kind: type[Any], message: str) -> Any:
    """An error of this kind with nothing but its message."""
    return kind.__new__(kind, message)


def _told(value: Any) -> str:
    """The text of a value in a message: one short line."""
    try:
        text = _text(value)
    except Exception:  # numbers too long to be written, objects whose repr fails
        text = f"a value of type {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _text(value: Any) -> str:
    if getattr(value, "ndim", None) == 0:  # NumPy's numbers, tensors
        value = value.item()
    if isinstance(value, Real) and not isinstance(value, Integral):
        return f"{float(value):g}"
    if type(value) in (list, tuple):
        items = ", ".join(map(_told, value[:_LONGEST]))
        comma = "," if type(value) is tuple and len(value) == 1 else ""
        return f"[{items}]" if type(value) is list else f"({items}{comma})"
    if hasattr(value, "shape"):
        return f"an array of shape {tuple(value.shape)}"
    return " ".join(repr(value).split())


def _portable(value: Any) -> Any:
    """The value if another process surely can read it, else its text."""
    if type(value).__module__ == "numpy" and getattr(value, "ndim", None) == 0:
        value = value.item()
    if value is None or type(value) in (bool, int, float, complex, str, bytes, _Nothing):
        return value
    if type(value) in (list, tuple):
        return type(value)(map(_portable, value))
    return _told(value)

"""Groups of settings, and the description of each field: unit, range, default, help, parser."""

import dataclasses
import math
import re
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from typing import Any, ClassVar

from bokehnet.errors import ErrorCollector, ParameterError

__all__ = [
    "Group",
    "Setting",
    "check_needed",
    "field_settings",
    "from_plain",
    "parse_bytes",
    "parse_numbers",
    "setting",
    "to_plain",
]

_KEY = "setting"

_SIZE = re.compile(r"(\d{1,15}(?:\.\d{1,9})?)\s*([KMGT]?)(?:i?B)?", re.IGNORECASE)
_BYTES = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}

# Names of types in messages.
_WORDS = {float: "a number", int: "a whole number", bool: "true or false", str: "a text", Path: "a path"}


@dataclass(frozen=True, kw_only=True, slots=True)
class Setting:
    """Description of one field of a group of settings.

    Attributes:
        group: Name of the group in ``RenderSettings``.
        name: Name of the field.
        type: Type of its values, without ``None``.
        default: Default value.
        help: Help text, one or two sentences.
        unit: Unit of its numbers, such as "mm"; empty if dimensionless.
        low: Lower bound, inclusive.
        high: Upper bound, inclusive.
        above: Lower bound, exclusive; replaces ``low``.
        below: Upper bound, exclusive; replaces ``high``.
        infinite: True if infinity is a valid value.
        expected: Expectation in error messages, where the range does not express it.
        accepts: Predicate on values of the right type within the range; None accepts all.
        advice: Function from a rejected value to a remedy, or to an empty text.
        flag: Key in flat tables and name of the option without its dashes; None for no option.
        aliases: Flags of earlier versions, which still work.
        metavar: Placeholder of the value in a help text.
        parse: Parser from text to value, where the type has none; raises ``ValueError``.
        parts: Number of command-line words that form one value.
        allowed_in_preset: True if a preset may set it; other fields describe scene, input or output.

    Examples:
        >>> from bokehnet.settings.look_settings import ApertureSettings
        >>> squeeze = field_settings(ApertureSettings)["squeeze"]
        >>> squeeze.path, squeeze.expectation, squeeze.parsed("0.5")
        ('aperture.squeeze', '0.1 to 10', 0.5)
    """

    group: str
    name: str
    type: Any
    default: Any
    help: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    above: float | None = None
    below: float | None = None
    infinite: bool = False
    expected: str = ""
    accepts: Callable[[Any], bool] | None = None
    advice: Callable[[Any], str] | None = None
    flag: str | None = None
    aliases: tuple[str, ...] = ()
    metavar: str | None = None
    parse: Callable[[str], Any] | None = None
    parts: int = 1
    allowed_in_preset: bool = False

    @property
    def path(self) -> str:
        """Group and name, joined by a dot."""
        return f"{self.group}.{self.name}"

    @property
    def choices(self) -> tuple[str, ...]:
        """Accepted words; empty if the field is not a choice."""
        return typing.get_args(self.type) if typing.get_origin(self.type) is typing.Literal else ()

    @property
    def expectation(self) -> str:
        """Expectation in error messages."""
        if self.expected:
            return self.expected
        if self.choices:
            return f"one of {', '.join(sorted(self.choices))}"
        word = _WORDS.get(self.type, "a value")
        unit = f" {self.unit}" if self.unit else ""
        low, high = self.low, self.high
        if low is not None and high is not None:
            return f"{low:g} to {high:g}{unit}"
        if low is not None and self.below is not None:
            return f"at least {low:g} and below {self.below:g}{unit}"
        if low is not None:
            return f"{word} of at least {low:g}{unit}"
        if self.above is not None:
            return f"{word} above {self.above:g}{unit}"
        if self.type is float:
            return f"a finite number{' of' + unit if unit else ''}"
        return word

    def checked(self, value: Any) -> Any:
        """Return ``value`` in the field's own type, or raise ``ParameterError`` naming the field."""
        if value is None and self.default is None:
            return None
        fitted = _fit(value, self.type)
        if fitted is _UNFIT or not self._within(fitted) or (self.accepts and not self.accepts(fitted)):
            expected = self.expectation
            if isinstance(fitted, float) and not math.isfinite(fitted):
                expected = expected.replace("a number", "a finite number")
            remedy = self.advice(value) if self.advice is not None else ""
            raise ParameterError(self.path, expected=expected, got=value, remedy=remedy)
        return fitted

    def parsed(self, text: str | Sequence[str]) -> Any:
        """Parse a text, or raise ``ParameterError`` naming the field."""
        try:
            if self.parse is not None:
                value = self.parse(text) if isinstance(text, str) else tuple(map(self.parse, text))
                try:
                    return self.checked(value)
                except ParameterError as error:  # show the text that the user wrote
                    raise ParameterError(self.path, error.expected, text) from error
            if self.type in (int, float, Path):
                return self.checked(self.type(text))
        except ParameterError as error:
            raise error.renamed(self.path) from error
        except (ValueError, OverflowError) as error:
            raise ParameterError(self.path, expected=self.expectation, got=text) from error
        if self.type is bool and text in ("true", "false"):
            return text == "true"
        return self.checked(text)

    def _within(self, value: Any) -> bool:
        numbers = value if isinstance(value, tuple) else (value,)
        for number in numbers:
            if not isinstance(number, int | float) or isinstance(number, bool):
                continue
            if math.isnan(number) or (math.isinf(number) and not self.infinite):
                return False
            if (self.low is not None and number < self.low) or (self.high is not None and number > self.high):
                return False
            if self.above is not None and not number > self.above:
                return False
            if self.below is not None and not number < self.below:
                return False
        return True


def setting(default: Any, help: str, **known: Any) -> Any:
    """Declare a field of a group: its default, its help, and further attributes of :class:`Setting`.

    Examples:
        >>> @dataclass(frozen=True)
        ... class GlowSettings(Group):
        ...     GROUP: ClassVar[str] = "glow"
        ...     radius: float = setting(4.0, "Radius of the glow.", unit="pixels", low=0, high=50)
        >>> field_settings(GlowSettings)["radius"].expectation
        '0 to 50 pixels'
    """
    return dataclasses.field(default=default, metadata={_KEY: {"help": help, **known}})


def field_settings(group: Any) -> Mapping[str, Setting]:
    """Return the description of each field of a group, an instance or its class, by name.

    Examples:
        >>> from bokehnet.settings.look_settings import HighlightSettings
        >>> {name: known.default for name, known in field_settings(HighlightSettings).items()}
        {'threshold': 'auto', 'strength': 1.0, 'gain': None, 'gamma': 1.0}
    """
    return _read_fields(group if isinstance(group, type) else type(group))


@cache
def _read_fields(group: Any) -> Mapping[str, Setting]:
    hints = typing.get_type_hints(group)
    settings = {}
    for item in dataclasses.fields(group):
        known = dict(item.metadata[_KEY])
        flag = known.pop("flag", item.name.replace("_", "-"))
        settings[item.name] = Setting(
            group=group.GROUP,
            name=item.name,
            type=_without_none(hints[item.name]),
            default=item.default,
            flag=flag,
            allowed_in_preset=known.pop("allowed_in_preset", group.ALLOWED_IN_PRESET),
            **known,
        )
    return settings


def _check_fields(group: Any) -> None:
    """Raise ``ParameterError`` unless each field has a value of its type and within its range."""
    errors = ErrorCollector()
    for name, known in field_settings(group).items():
        with errors.collect():
            object.__setattr__(group, name, known.checked(getattr(group, name)))
    errors.raise_all()


@dataclass(frozen=True, kw_only=True, slots=True)
class Group:
    """Settings that belong together; the constructor checks each field.

    Examples:
        >>> @dataclass(frozen=True)
        ... class GlowSettings(Group):
        ...     GROUP: ClassVar[str] = "glow"
        ...     radius: float = setting(4.0, "Radius of the glow.", unit="pixels", low=0, high=50)
        >>> GlowSettings(radius=80)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: glow.radius: expected 0 to 50 pixels, got 80
    """

    GROUP: ClassVar[str]
    TITLE: ClassVar[str]
    ALLOWED_IN_PRESET: ClassVar[bool] = False
    ONE_OF: ClassVar[tuple[str, ...]] = ()  # mutually exclusive fields

    def __post_init__(self) -> None:
        _check_fields(self)
        conflicting = [name for name in self.ONE_OF if getattr(self, name) not in (None, "off")]
        if len(conflicting) > 1:
            two = len(conflicting) == 2
            raise ParameterError(
                f"{self.GROUP}.{conflicting[1]}",
                expected=f"one of {' and '.join(f'`{self.GROUP}.{name}`' for name in conflicting)}",
                shown="both" if two else "all",
                remedy="leave one out" if two else "keep one",
            )
        self.check()

    def check(self) -> None:
        """Raise ``ParameterError`` unless the fields are consistent."""


def check_needed(group: "Group", name: str, needed: str, also: str | None = None, why: str = "") -> None:
    """Raise ``ParameterError`` if ``name`` is set but the field that it modifies is not.

    Args:
        group: Group to check.
        name: Field that has no effect alone.
        needed: Field that it modifies.
        also: Alternative to ``needed``.
        why: Explanation for the message.

    Examples:
        >>> from bokehnet.settings.look_settings import LensSettings
        >>> check_needed(LensSettings(name="petzval", f_number=4), "f_number", "name")
        >>> LensSettings(f_number=4)  # its `check` calls this
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: lens.f_number: expected `lens.name` for it to act on, ...
    """
    value = getattr(group, name)
    if value is None or value is False or _is_set(group, needed) or (also and _is_set(group, also)):
        return
    alternatives = f"`{group.GROUP}.{needed}`" + (f" or `{group.GROUP}.{also}`" if also else "")
    raise ParameterError(
        f"{group.GROUP}.{name}",
        expected=f"{alternatives} for it to act on{f'; {why}' if why else ''}",
        got=value,
        remedy="give that, or leave this out",
        shown="it alone" if value is True else None,
    )


def _is_set(group: "Group", name: str) -> bool:
    """Return whether a field has an effect; 0 counts where the default is None."""
    value = getattr(group, name)
    return bool(value) or (value == 0 and field_settings(group)[name].default is None)


def from_plain(known: Setting, value: Any) -> Any:
    """Convert a number, text, boolean or list of a file to the value of a field.

    Examples:
        >>> from bokehnet.settings.settings import EngineSettings, FocusSettings
        >>> from_plain(field_settings(EngineSettings)["max_memory"], "1.5G")  # bytes
        1610612736
        >>> from_plain(field_settings(FocusSettings)["range"], [0.5, 2])
        (0.5, 2.0)
    """
    if isinstance(value, str) and (known.parse is not None or known.type is Path):
        return known.parsed(value)
    return known.checked(value)


def to_plain(value: Any) -> Any:
    """Convert a value to the types of files: tuples become lists, paths texts.

    Examples:
        >>> to_plain((0.5, 2.0)), to_plain(Path("maps"))
        ([0.5, 2.0], 'maps')
    """
    if isinstance(value, tuple):
        return [to_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def parse_numbers(text: str) -> tuple[float, ...]:
    """Return the numbers of a text such as ``0.5,2``.

    Examples:
        >>> parse_numbers("0.5,2")
        (0.5, 2.0)
    """
    return tuple(float(part) for part in text.split(","))


def parse_bytes(text: str) -> int:
    """Return the bytes of a text such as ``500M`` or ``1.5G``, powers of 1024.

    Raises:
        ValueError: The text is no size.

    Examples:
        >>> parse_bytes("1.5k"), parse_bytes("2 GiB")
        (1536, 2147483648)
    """
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise ValueError(text)
    return int(float(match[1]) * _BYTES[match[2].upper()])


class _Unfit:
    """Sentinel for a value of the wrong type."""


_UNFIT = _Unfit()


def _fit(value: Any, kind: Any) -> Any:
    """Convert ``value`` to type ``kind``: integers to floats, lists to tuples; otherwise ``_UNFIT``."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        fitted = [_fit(value, option) for option in arguments if option is not type(None)]
        return next((one for one in fitted if one is not _UNFIT), _UNFIT)
    if origin is typing.Literal:
        word = str(value) if type(value) is int else value  # a number may be one of the words
        return word if isinstance(word, str) and word in arguments else _UNFIT
    if origin is tuple:
        if not isinstance(value, tuple | list):
            return _UNFIT
        repeated = len(arguments) == 2 and arguments[1] is Ellipsis
        kinds = [arguments[0]] * len(value) if repeated else list(arguments)
        if len(kinds) != len(value) or not kinds:
            return _UNFIT
        parts = tuple(_fit(item, item_kind) for item, item_kind in zip(value, kinds, strict=True))
        return _UNFIT if _UNFIT in parts else parts
    if isinstance(value, bool):
        return value if kind is bool else _UNFIT
    if kind is Path:
        return Path(value) if isinstance(value, str | Path) else _UNFIT
    if kind is str:
        return value if isinstance(value, str) else _UNFIT
    return _fit_number(value, kind) if kind in (int, float) else _UNFIT


def _fit_number(value: Any, kind: Any) -> Any:
    """Convert a Python or NumPy number to ``int`` or ``float``; ``_UNFIT`` if too large for a float."""
    if getattr(value, "ndim", None) == 0:
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, Integral if kind is int else Real):
        return _UNFIT
    try:
        number = float(value)
    except OverflowError:
        return _UNFIT
    return int(value) if isinstance(value, Integral) and kind is int else number


def _without_none(hint: Any) -> Any:
    """Return ``X`` of ``X | None``."""
    arguments = [kind for kind in typing.get_args(hint) if kind is not type(None)]
    if typing.get_origin(hint) in (typing.Union, types.UnionType) and len(arguments) == 1:
        return arguments[0]
    return hint

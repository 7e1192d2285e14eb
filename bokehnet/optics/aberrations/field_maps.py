"""Maps over the field of a picture: how strong an effect is, from the middle to the corners and around them.

A map is a plain function ``m(t, theta)`` of arrays or tensors: t is the distance from the middle of the
picture, 1 in the corner, and theta the direction, radians, counter-clockwise as seen, 0 to the right.
:func:`compose` makes new ones of old ones: what the first returns is the second's t.

Source: Jeong, Lee, Kwon and Lee, "Expressive chromatic accumulation buffering for defocus blur", The
Visual Computer 2016, for composed maps and the functions themselves; guards are ours.
"""

from collections.abc import Callable
from functools import partial

from bokehnet.checks import Array, array_namespace, check_kind, check_number
from bokehnet.errors import ParameterError

__all__ = [
    "FIELD_MAPS",
    "FieldMap",
    "angular",
    "compose",
    "constant",
    "cosine",
    "cube",
    "exponential",
    "inversion",
    "linear",
    "make_field_map",
    "power",
    "reciprocal",
    "square",
]

FieldMap = Callable[[Array, Array], Array]

# The reciprocal stays below 1 over this.
_SMALLEST = 0.1

_HIGHEST_NUMBER = 12.0


def constant(t: Array, theta: Array) -> Array:
    """1 everywhere."""
    return 1 + 0 * t


def linear(t: Array, theta: Array) -> Array:
    """``t``: 0 in the middle, 1 in the corners."""
    return t


def square(t: Array, theta: Array) -> Array:
    """``t^2``."""
    return t * t


def cube(t: Array, theta: Array) -> Array:
    """``t^3``."""
    return t * t * t


def exponential(t: Array, theta: Array) -> Array:
    """``exp(t)``."""
    return array_namespace(t).exp(t)


def inversion(t: Array, theta: Array) -> Array:
    """``1 - t``: the middle for the corners."""
    return 1 - t


def reciprocal(t: Array, theta: Array) -> Array:
    """``1 / t``; where t is below 0.1 it stays at 10."""
    return 1 / array_namespace(t).clip(t, _SMALLEST, None)


def cosine(t: Array, theta: Array) -> Array:
    """``cos(2 pi t)``: rings of both signs."""
    return array_namespace(t).cos(6.283185307179586 * t)


def angular(turns: float = 1) -> FieldMap:
    """``t cos(turns theta)``: sectors of both signs; if turns are not whole there is a seam on the left."""
    return partial(_sectors, turns)


def _sectors(turns: float, t: Array, theta: Array) -> Array:
    return t * array_namespace(theta).cos(turns * theta)


def power(exponent: float = 1) -> FieldMap:
    """``t^exponent``; t below 0, as other maps may return it, counts as 0."""
    return partial(_raised, exponent)


def _raised(exponent: float, t: Array, theta: Array) -> Array:
    return array_namespace(t).clip(t, 0, None) ** exponent


def compose(g: FieldMap, f: FieldMap) -> FieldMap:
    """First f, then g: ``g(f(t, theta), theta)``."""
    return partial(_composed, g, f)


def _composed(g: FieldMap, f: FieldMap, t: Array, theta: Array) -> Array:
    return g(f(t, theta), theta)


FIELD_MAPS: dict[str, FieldMap] = {
    "constant": constant,
    "linear": linear,
    "square": square,
    "cube": cube,
    "exponential": exponential,
    "inversion": inversion,
    "reciprocal": reciprocal,
    "cosine": cosine,
    "angular": angular(),
}

# Maps that take a number, as in ``power:2.5``.
_NUMBERED = {"angular": angular, "power": power}


def make_field_map(field_map: str) -> FieldMap:
    """Return the map that a text names.

    Args:
        field_map: Names of ``FIELD_MAPS``, or ``power:N`` and ``angular:N`` with a number above 0, separated
            by commas; the first is applied first: ``inversion,reciprocal`` is ``1 / (1 - t)``.

    Raises:
        ParameterError: A name or a number is not known.
    """
    result: FieldMap | None = None
    check_kind("field_map", field_map, str)
    for part in field_map.split(","):
        atom = _make_atom(part.strip())
        result = atom if result is None else compose(atom, result)
    assert result is not None
    return result


def _make_atom(text: str) -> FieldMap:
    name, colon, number = text.partition(":")
    if not colon and name in FIELD_MAPS:
        return FIELD_MAPS[name]
    if colon and name in _NUMBERED:
        return _NUMBERED[name](_read_number(text, number))
    expected = f"names of {', '.join(FIELD_MAPS)}, power:N or angular:N, separated by commas"
    raise ParameterError("field_map", expected, text)


def _read_number(text: str, number: str) -> float:
    try:
        value = float(number)
    except ValueError:
        raise ParameterError("field_map", "a number after the colon", text) from None
    check_number("field_map", value)
    if not 0 < value <= _HIGHEST_NUMBER:
        raise ParameterError("field_map", f"a number above 0 and up to {_HIGHEST_NUMBER:g}", text)
    return value

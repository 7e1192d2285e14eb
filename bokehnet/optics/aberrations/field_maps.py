"""Field maps: the strength of an effect as a function of the position in the picture.

A map is a plain function ``m(t, theta)`` of arrays or tensors: t is the distance from the centre of the
picture, 1 in the corner, and theta the direction, radians, counter-clockwise as seen, 0 to the right.
:func:`compose` combines maps: the value of the first is the t of the second.

Source: Jeong, Lee, Kwon and Lee, "Expressive chromatic accumulation buffering for defocus blur", The
Visual Computer 2016, for composed maps and the functions themselves; guards are our own.
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

# Lower bound of the argument of the reciprocal.
_MIN_DIVISOR = 0.1

# Upper bound of exponents and numbers of sectors.
_MAX_NUMBER = 12.0


def constant(t: Array, theta: Array) -> Array:
    """Return 1 everywhere."""
    return 1 + 0 * t


def linear(t: Array, theta: Array) -> Array:
    """Return ``t``: 0 at the centre, 1 in the corners."""
    return t


def square(t: Array, theta: Array) -> Array:
    """Return ``t^2``."""
    return t * t


def cube(t: Array, theta: Array) -> Array:
    """Return ``t^3``."""
    return t * t * t


def exponential(t: Array, theta: Array) -> Array:
    """Return ``exp(t)``."""
    return array_namespace(t).exp(t)


def inversion(t: Array, theta: Array) -> Array:
    """Return ``1 - t``: exchanges centre and corners."""
    return 1 - t


def reciprocal(t: Array, theta: Array) -> Array:
    """Return ``1 / t``, at most 10."""
    return 1 / array_namespace(t).clip(t, _MIN_DIVISOR, None)


def cosine(t: Array, theta: Array) -> Array:
    """Return ``cos(2 pi t)``: rings of both signs."""
    return array_namespace(t).cos(6.283185307179586 * t)


def angular(turns: float = 1) -> FieldMap:
    """Return the map ``t cos(turns theta)``: sectors of both signs, with a seam unless ``turns`` is whole."""
    return partial(_sectors, turns)


def _sectors(turns: float, t: Array, theta: Array) -> Array:
    return t * array_namespace(theta).cos(turns * theta)


def power(exponent: float = 1) -> FieldMap:
    """Return the map ``t^exponent``; t below 0, as other maps may return it, counts as 0."""
    return partial(_power, exponent)


def _power(exponent: float, t: Array, theta: Array) -> Array:
    return array_namespace(t).clip(t, 0, None) ** exponent


def compose(g: FieldMap, f: FieldMap) -> FieldMap:
    """Return the map ``g(f(t, theta), theta)``: first f, then g."""
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

# Maps with a numeric parameter, as in ``power:2.5``.
_PARAMETRIC_MAPS = {"angular": angular, "power": power}


def make_field_map(field_map: str) -> FieldMap:
    """Return the map with the given name.

    Args:
        field_map: Names of ``FIELD_MAPS``, or ``power:N`` and ``angular:N`` with a number above 0, separated
            by commas; the first is applied first: ``inversion,reciprocal`` is ``1 / (1 - t)``.

    Raises:
        ParameterError: Unknown name, or a number out of range.
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
    if colon and name in _PARAMETRIC_MAPS:
        return _PARAMETRIC_MAPS[name](_read_number(text, number))
    expected = f"names of {', '.join(FIELD_MAPS)}, power:N or angular:N, separated by commas"
    raise ParameterError("field_map", expected, text)


def _read_number(text: str, number: str) -> float:
    try:
        value = float(number)
    except ValueError:
        raise ParameterError("field_map", "a number after the colon", text) from None
    check_number("field_map", value)
    if not 0 < value <= _MAX_NUMBER:
        raise ParameterError("field_map", f"a number above 0 and up to {_MAX_NUMBER:g}", text)
    return value

"""Earlier names of public attributes, keywords and classes, which work with a ``DeprecationWarning``."""

import warnings
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

__all__ = ["EARLIER_NAMES", "earlier_class", "earlier_name", "renamed_keywords", "warn_deprecated"]

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

# Present names by earlier names, of a class, a function or a module; all are of version 0.1.
EARLIER_NAMES: dict[str, dict[str, str]] = {
    "KnownSurfaces": {"in_light": "with_mapped_colors"},
    "Layers": {"in_light": "with_mapped_colors"},
    "LensResponse": {"is_plain": "is_ideal"},
    "PrescriptionLens": {"fastest": "min_f_number"},
    "RenderOptions": {"memory_taken": "memory_in_use", "place": "viewport", "rays_share": "rays_factor"},
    "bokehnet.effects": {"View": "Viewport"},
    "scatter": {"place": "viewport"},
    "write_frame": {"beside": "extra_channels", "wanted": "output_format"},
    "write_image": {"beside": "extra_channels"},
}


def warn_deprecated(message: str, level: int = 1) -> None:
    """Warn the caller of the function that calls this one, or one ``level`` calls above."""
    warnings.warn(message, DeprecationWarning, stacklevel=level + 2)


def renamed_keywords(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Let a function of :data:`EARLIER_NAMES` accept its earlier keywords.

    Examples:
        >>> @renamed_keywords
        ... def write_image(extra_channels):
        ...     return 2 * extra_channels
        >>> write_image(beside=3)
        6
    """
    new_names = EARLIER_NAMES[function.__name__]

    @wraps(function)
    def with_earlier_names(*args: Any, **keywords: Any) -> Result:
        for name in new_names.keys() & keywords.keys():
            warn_deprecated(f"use {new_names[name]}= instead of {name}=; version 0.3 removes it")
            keywords.setdefault(new_names[name], keywords.pop(name))
        return function(*args, **keywords)

    return with_earlier_names  # type: ignore[return-value]  # earlier names are not in the signature


def earlier_name(owner: str, old: str) -> Any:
    """Return a property that warns and gives the attribute or method under its present name.

    Args:
        owner: Class in :data:`EARLIER_NAMES`.
        old: Earlier name, which the property is assigned to.

    Examples:
        >>> class Lens:
        ...     min_f_number = 1.4
        ...     fastest = earlier_name("PrescriptionLens", "fastest")
        >>> Lens().fastest
        1.4
    """
    new = EARLIER_NAMES[owner][old]

    def get(self: Any) -> Any:
        warn_deprecated(f"{type(self).__name__}.{old} is now {new}")
        return getattr(self, new)

    return property(get, doc=f"Earlier name of ``{new}``.")


def earlier_class(module: str, names: dict[str, Any]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a module that warns and gives classes under their present names.

    Args:
        module: Module in :data:`EARLIER_NAMES`.
        names: Names of the module, ``globals()``.
    """

    def get(name: str) -> Any:
        new = EARLIER_NAMES[module].get(name)
        if new is None:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        warn_deprecated(f"{module}.{name} is now {new}")
        return names[new]

    return get

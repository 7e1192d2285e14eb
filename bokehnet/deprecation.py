"""Earlier names of public attributes, which work for one more version."""

import warnings
from typing import Any

__all__ = ["earlier_name"]


def earlier_name(old: str, new: str) -> Any:
    """Return a property that warns and gives the attribute or method under its present name.

    Args:
        old: Earlier name, which the property is assigned to.
        new: Present name.

    Examples:
        >>> class Lens:
        ...     min_f_number = 1.4
        ...     fastest = earlier_name("fastest", "min_f_number")
        >>> Lens().fastest
        1.4
    """

    def get(self: Any) -> Any:
        message = f"{type(self).__name__}.{old} is now {new}"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return getattr(self, new)

    return property(get, doc=f"Earlier name of ``{new}``.")

"""The character of a lens, as renderers take it: where its rays go, and what light they carry."""

from dataclasses import dataclass, field

import numpy as np

from bokehnet.checks import check_kind
from bokehnet.optics.fringes import Fringes
from bokehnet.optics.light_draw import LightDraw
from bokehnet.optics.pencil import PencilMap

__all__ = ["Character"]


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class Character:
    """What a lens does beyond focusing; the default is a perfect lens.

    Attributes:
        pencil: Where its rays go.
        fringes: Chromatic aberration beyond that of the pencil.
        light: Which wavelengths stand for the light, and what each carries of red, green and blue.

    Raises:
        ParameterError: One of them is something else.
    """

    pencil: PencilMap = field(default_factory=PencilMap.perfect)
    fringes: Fringes | None = None
    light: LightDraw = field(default_factory=LightDraw)

    def __post_init__(self) -> None:
        check_kind("pencil", self.pencil, PencilMap)
        check_kind("fringes", self.fringes, Fringes, optional=True)
        check_kind("light", self.light, LightDraw)

    @property
    def is_plain(self) -> bool:
        """Whether a picture through this lens is one through a perfect lens."""
        return self.pencil.is_perfect and (self.fringes is None or self.fringes.is_none)

    @property
    def is_dispersive(self) -> bool:
        """Whether wavelengths go different ways."""
        return self.pencil.is_dispersive or not (self.fringes is None or self.fringes.is_none)

    def draw(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Wavelengths (count,) and their red, green, blue (count, 3), of mean 1 each.

        Where the lens does not part wavelengths, all are the design wavelength and white.
        """
        if self.is_dispersive:
            return self.light.draw(count)
        return np.full(count, float(np.median(self.pencil.wavelengths))), np.ones((count, 3))

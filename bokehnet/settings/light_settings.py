"""Settings of what only light does: diffraction, reflections between surfaces, scatter."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from bokehnet.errors import ParameterError
from bokehnet.settings.fields import Group, check_needed, field_settings, setting

__all__ = ["LightSettings"]


@dataclass(frozen=True, kw_only=True, slots=True)
class LightSettings(Group):
    """What waves, reflections and dust make of lamps.

    Examples:
        >>> LightSettings(starburst=16).starburst  # f-number
        16.0
        >>> LightSettings(pixel_pitch=4)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: light.pixel_pitch: expected `light.rings` or `light.starburst` ...
    """

    GROUP: ClassVar[str] = "light"
    TITLE: ClassVar[str] = "Light, what waves and glass make of lamps"
    OF_A_LOOK: ClassVar[bool] = True

    rings: float | None = setting(
        None,
        "Fresnel rings in discs of lamps: diffraction at this f-number, such as 2.8.",
        metavar="F-NUMBER",
        low=0.5,
        high=64,
    )
    starburst: float | None = setting(
        None,
        "Stars around lamps: diffraction by the blades at this f-number, such as 16.",
        metavar="F-NUMBER",
        low=0.5,
        high=64,
    )
    pixel_pitch: float | None = setting(
        None,
        "With --rings or --starburst: width of a pixel; default from --sensor-width, else 36 mm across.",
        unit="micrometres",
        low=0.3,
        high=100,
    )
    ghosts: Literal["none", "single", "ideal"] | None = setting(
        None,
        "With --lens: ghosts of lamps, reflected twice by glass without coating (none), with one layer "
        "(single) or with the best one (ideal).",
    )
    lamps: float = setting(
        0.9,
        "With --rings, --starburst or --ghosts: pixels from this light up are lamps, after --highlights.",
        low=0,
        high=1e6,
    )
    glare: float = setting(
        0.0,
        "Share of all light that the lens scatters into a veil, 0 to 0.5; real lenses 0.01 to 0.05.",
        low=0,
        high=0.5,
    )
    glare_core: float | None = setting(
        None,
        "With --glare: radius within which the veil of a lamp is flat, percent of half the picture's "
        "diagonal; default 0.2.",
        metavar="PERCENT",
        unit="percent",
        low=0.01,
        high=20,
    )
    glare_slope: float | None = setting(
        None, "With --glare: power by which it falls farther out, 1 to 4; default 2.", low=1, high=4
    )

    def check(self) -> None:
        """See :class:`Group`."""
        check_needed(self, "pixel_pitch", "rings", "starburst")
        for name in ("glare_core", "glare_slope"):
            check_needed(self, name, "glare")
        said = self.lamps != field_settings(self)["lamps"].default
        if said and not (self.rings or self.starburst or self.ghosts):
            raise ParameterError(
                "light.lamps",
                expected="`light.rings`, `light.starburst` or `light.ghosts` for it to act on",
                got=self.lamps,
                remedy="give one, or leave this out",
            )

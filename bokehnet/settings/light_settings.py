"""Settings of diffraction, ghosts (reflections between lens surfaces) and glare (scatter in the lens)."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from bokehnet.errors import ParameterError
from bokehnet.settings.fields import Group, check_needed, field_settings, setting

__all__ = ["LightSettings"]


@dataclass(frozen=True, kw_only=True, slots=True)
class LightSettings(Group):
    """Diffraction, ghosts and glare of bright lights.

    Examples:
        >>> LightSettings(starburst=16).starburst  # f-number
        16.0
        >>> LightSettings(pixel_pitch=4)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: light.pixel_pitch: expected `light.rings` or `light.starburst` ...
    """

    GROUP: ClassVar[str] = "light"
    TITLE: ClassVar[str] = "Diffraction, ghosts and glare"
    ALLOWED_IN_PRESET: ClassVar[bool] = True

    rings: float | None = setting(
        None,
        "Fresnel rings in the discs of lights: diffraction at this f-number, such as 2.8.",
        metavar="F-NUMBER",
        low=0.5,
        high=64,
    )
    starburst: float | None = setting(
        None,
        "Stars around lights: diffraction by the blades at this f-number, such as 16.",
        metavar="F-NUMBER",
        low=0.5,
        high=64,
    )
    pixel_pitch: float | None = setting(
        None,
        "With --rings or --starburst: pixel pitch in micrometres. Default: from --sensor-width, else for a "
        "sensor 36 mm wide.",
        unit="micrometres",
        low=0.3,
        high=100,
    )
    ghosts: Literal["none", "single", "ideal"] | None = setting(
        None,
        "With --lens: ghosts of lights, reflected by two lens surfaces. Coating of the surfaces: none, "
        "single "
        "(one layer) or ideal.",
    )
    lamps: float = setting(
        0.9,
        "With --rings, --starburst or --ghosts: linear light from which pixels count as lights, after "
        "--highlights. Default: 0.9.",
        low=0,
        high=1e6,
    )
    glare: float = setting(
        0.0,
        "Fraction of the light that the lens scatters as veiling glare, 0 to 0.5; real lenses 0.01 to 0.05.",
        low=0,
        high=0.5,
    )
    glare_core: float | None = setting(
        None,
        "With --glare: radius of the flat core of the glare, percent of half the picture's diagonal. "
        "Default: 0.2.",
        metavar="PERCENT",
        unit="percent",
        low=0.01,
        high=20,
    )
    glare_slope: float | None = setting(
        None, "With --glare: exponent of its falloff outside the core, 1 to 4. Default: 2.", low=1, high=4
    )

    def check(self) -> None:
        """See :class:`Group`."""
        check_needed(self, "pixel_pitch", "rings", "starburst")
        for name in ("glare_core", "glare_slope"):
            check_needed(self, name, "glare")
        changed = self.lamps != field_settings(self)["lamps"].default
        if changed and not (self.rings or self.starburst or self.ghosts):
            raise ParameterError(
                "light.lamps",
                expected="`light.rings`, `light.starburst` or `light.ghosts` for it to act on",
                got=self.lamps,
                remedy="give one, or leave this out",
            )

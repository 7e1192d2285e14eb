"""Settings of a look: the shape of the blur, the lens, its colours, highlights, effects of the camera."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from bokehnet.errors import ParameterError
from bokehnet.settings.fields import Group, check_needed, field_settings, parse_numbers, setting

__all__ = ["ApertureSettings", "ColorSettings", "EffectSettings", "HighlightSettings", "LensSettings"]


def _gains(text: str) -> tuple[float, ...] | Path:
    """Numbers separated by commas, else the path of a file of them."""
    try:
        return parse_numbers(text)
    except ValueError:
        return Path(text)


@dataclass(frozen=True, kw_only=True, slots=True)
class ApertureSettings(Group):
    """The shape of the lens opening.

    Examples:
        >>> ApertureSettings(blades=7, rotation=15).rotation  # degrees
        15.0
        >>> ApertureSettings(blades=2)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: aperture.blades: expected 0 (disc) or 3 to 16, got 2
    """

    GROUP: ClassVar[str] = "aperture"
    TITLE: ClassVar[str] = "Aperture, or the shape of the blur"
    OF_A_LOOK: ClassVar[bool] = True

    blades: int = setting(
        0,
        "Blades of the aperture, 3 to 16; 0 is a disc.",
        expected="0 (disc) or 3 to 16",
        accepts=lambda count: count == 0 or 3 <= count <= 16,
    )
    curvature: float | None = setting(
        None, "With --blades: 0 (straight, the default) to 1 (disc).", flag="blade-curvature", low=0, high=1
    )
    rotation: float | None = setting(
        None,
        "Turn of blades or aperture image, degrees counter-clockwise.",
        flag="aperture-rotation",
        unit="degrees",
    )
    squeeze: float = setting(
        1.0, "Width over height of the blur disc, 0.1 to 10; below 1 for anamorphic ovals.", low=0.1, high=10
    )
    cats_eye: float = setting(
        0.0, "Clipping of the blur disc in the corners of the picture, 0 to 1.5.", low=0, high=1.5
    )
    image: Path | None = setting(
        None,
        "Picture of the opening as seen from behind the camera, bright where light passes; any size. Lights "
        "behind focus show it upright, in front of focus turned by half a turn.",
        flag="aperture-image",
    )
    spherical_profile: float = setting(
        0.0,
        "Light at the rim of discs behind focus, -1 (dark) to 1 (bright); else reversed.",
        flag="rim",
        low=-1,
        high=1,
    )
    obstruction: float = setting(
        0.0, "Radius of the dark core of a mirror lens, 0 to 0.95 of the disc.", low=0, high=0.95
    )
    onion: float = setting(
        0.0, "Rings inside discs, as machined lenses draw them, 0 to 1 (strongest).", low=0, high=1
    )
    onion_rings: float | None = setting(
        None, "With --onion: rings from middle to rim, 1 to 40; default 12.", low=1, high=40
    )
    grain: float = setting(
        0.0, "Dust and uneven coating inside discs, 0 to 1 (strongest).", flag="disc-grain", low=0, high=1
    )
    grain_seed: int | None = setting(
        None, "With --disc-grain: which grain, a whole number from 0 up.", flag="disc-grain-seed", low=0
    )

    def check(self) -> None:
        """See :class:`Group`."""
        check_needed(self, "curvature", "blades")
        check_needed(self, "rotation", "blades", "image", why="a disc has no direction")
        check_needed(self, "onion_rings", "onion")
        check_needed(self, "grain_seed", "grain")


@dataclass(frozen=True, kw_only=True, slots=True)
class LensSettings(Group):
    """The look of a lens: glass that is traced, and aberrations by hand.

    Examples:
        >>> LensSettings(name="petzval", f_number=5.6).f_number
        5.6
        >>> LensSettings(f_number=5.6)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: lens.f_number: expected `lens.name` for it to act on, ...
    """

    GROUP: ClassVar[str] = "lens"
    TITLE: ClassVar[str] = "Lens look, glass and aberrations"
    OF_A_LOOK: ClassVar[bool] = True

    name: str | None = setting(
        None,
        "Render through this lens, with all its aberrations; bokehnet lens lists them. Files of Zemax, "
        "CODE V, OSLO, optiland and ray-optics are taken as they are.",
        flag="lens",
        metavar="NAME|FILE",
    )
    aberrations: Literal["traced", "seidel"] | None = setting(
        None, "With --lens: traced through its glass (default), or by third-order theory."
    )
    f_number: float | None = setting(
        None,
        "With --lens: stop it down to this; default: --f-number, else fully open.",
        flag="lens-f-number",
        above=0,
    )
    distortion: bool = setting(
        False, "With --lens: bend a picture without distortion as it does.", flag="lens-distortion"
    )
    vignetting: bool = setting(
        True,
        "With --lens: darken towards the corners as it does, by its rims and by the slant of light.",
        flag="lens-vignetting",
    )
    focusing: Literal["sharpest", "paraxial"] | None = setting(
        None,
        "With --lens or --spherical: focus where blur is least (sharpest, default), or where rays near the "
        "axis meet (paraxial).",
    )
    copy_to_copy: float | None = setting(
        None,
        "With --lens: elements off their places, as in one copy of a lens, 0 (as designed) to 10; at 1 by up "
        "to 0.02 mm and degrees. The focus leans and gaps change; bokehnet lens copy tells more.",
        low=0,
        high=10,
    )
    copy_seed: int | None = setting(None, "With --copy-to-copy: which copy, a whole number from 0 up.", low=0)
    table: Path | None = setting(
        None,
        "Aberrations by wavelength: a CSV file, as bokehnet lens aberrations writes it of a lens.",
        flag="aberration-table",
        metavar="FILE.csv",
    )
    spherical: float = setting(
        0.0,
        "Blur by the rim of the lens: above 0 discs behind focus get a bright rim (soap bubbles), "
        "below 0 they fade out. These four in percent of half the picture's diagonal.",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )
    coma: float = setting(
        0.0,
        "Tails in the corners: above 0 outwards, below 0 inwards.",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )
    astigmatism: float = setting(
        0.0,
        "Above 0 discs behind focus swirl around the middle, below 0 they point to it.",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )
    field_curvature: float = setting(
        0.0,
        "Above 0 the corners focus farther away than the middle, below 0 nearer.",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )

    def check(self) -> None:
        """See :class:`Group`."""
        for name in ("aberrations", "distortion", "f_number", "copy_to_copy"):
            check_needed(self, name, "name")
        check_needed(self, "copy_seed", "copy_to_copy")
        check_needed(self, "focusing", "name", "spherical")


@dataclass(frozen=True, kw_only=True, slots=True)
class ColorSettings(Group):
    """Colours that part: chromatic aberration.

    Examples:
        >>> ColorSettings(axial=0.3, glass="achromat").axial  # percent of the half-diagonal
        0.3
        >>> ColorSettings(glass="achromat")
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: color.glass: expected `color.axial` or `color.lateral` for it ...
    """

    GROUP: ClassVar[str] = "color"
    TITLE: ClassVar[str] = "Colour, chromatic aberration"
    OF_A_LOOK: ClassVar[bool] = True

    axial: float = setting(
        0.0,
        "Blur that colours differ by, violet to red, percent of the half-diagonal; "
        "above 0 as in a simple lens: red rims in front of focus, blue rims behind it.",
        flag="axial-fringe",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )
    lateral: float = setting(
        0.0,
        "How far violet lies outwards of red in the corners, percent of the half-diagonal.",
        flag="lateral-fringe",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )
    axial_map: str | None = setting(
        None,
        "With --axial-fringe: its factor over the picture, names joined by commas: constant (default), "
        "linear, square, cube, exponential, inversion, reciprocal, cosine, angular, power:N, angular:N.",
        metavar="NAMES",
    )
    lateral_map: str | None = setting(
        None, "With --lateral-fringe: the same; default linear.", metavar="NAMES"
    )
    glass: str | None = setting(
        None,
        "What parts the colours: a glass (default N-BK7), achromat (green from purple) or linear.",
        flag="fringe-glass",
        metavar="NAME",
    )
    dispersion: Literal["continuous", "rgb"] | None = setting(
        None, "Colours of fringes: continuous (default), or rgb: three alone."
    )
    equaliser: tuple[float, ...] | Path | None = setting(
        None,
        "Weights of the colours in fringes, violet to red, such as 1,1,0,0,3,1,1; or a file of them.",
        metavar="GAINS",
        parse=_gains,
        low=0,
        expected="numbers from 0 up separated by commas, or a file of them",
    )

    def check(self) -> None:
        """See :class:`Group`."""
        check_needed(self, "axial_map", "axial")
        check_needed(self, "lateral_map", "lateral")
        check_needed(self, "glass", "axial", "lateral")


@dataclass(frozen=True, kw_only=True, slots=True)
class HighlightSettings(Group):
    """How light is weighed before it is blurred.

    Examples:
        >>> HighlightSettings(threshold=0.8, gain=6).gain  # what white becomes
        6.0
        >>> HighlightSettings(gain=6)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: highlights.gain: expected `highlights.threshold` for it to ...
    """

    GROUP: ClassVar[str] = "highlights"
    TITLE: ClassVar[str] = "Highlights, how light is weighed"
    OF_A_LOOK: ClassVar[bool] = True

    threshold: float | None = setting(
        None,
        "Brighten clipped lights before blurring: linear light above this, 0 to below 1, is expanded.",
        flag="highlights",
        metavar="THRESHOLD",
        low=0,
        below=1,
    )
    gain: float | None = setting(
        None,
        "With --highlights: what white becomes; default 8.",
        flag="highlight-gain",
        metavar="GAIN",
        low=1,
    )
    gamma: float = setting(
        1.0, "Above 1 bright pixels prevail where light mixes, 0.2 to 5; 1 is a real lens.", low=0.2, high=5
    )

    def check(self) -> None:
        """See :class:`Group`."""
        check_needed(self, "gain", "threshold")


@dataclass(frozen=True, kw_only=True, slots=True)
class EffectSettings(Group):
    """What the camera does to the blurred picture.

    Examples:
        >>> EffectSettings(vignette=0.7, grain=1600).vignette  # stops
        0.7
        >>> EffectSettings(distortion=-0.03, brown=(0.1, 0.02))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: effects.brown: expected one of `effects.distortion` and ...
    """

    GROUP: ClassVar[str] = "effects"
    TITLE: ClassVar[str] = "Effects of the camera on the blurred picture"
    OF_A_LOOK: ClassVar[bool] = True

    distortion: float = setting(
        0.0,
        "How far the corner moves: -0.1 inwards by 10 % (barrel), above 0 outwards.",
        low=-0.9,
        high=0.9,
    )
    brown: tuple[float, ...] | None = setting(
        None,
        "Distortion by Brown and Conrady, for radii in half-diagonals of the picture.",
        flag="distortion-brown",
        metavar="K1[,K2[,K3[,P1,P2]]]",
        parse=parse_numbers,
        expected="finite K1[,K2[,K3[,P1,P2]]] such as -0.1,0.02",
        accepts=lambda numbers: len(numbers) in (1, 2, 3, 5),
    )
    cos4: float = setting(
        0.0,
        "Darken by the cos^4 law; half the view across the diagonal, 0 to 80.",
        metavar="DEGREES",
        unit="degrees",
        low=0,
        high=80,
    )
    optical_vignetting: float = setting(
        0.0, "Darken by what the barrel cuts off in the corners, 0 to 1.5, as --cats-eye.", low=0, high=1.5
    )
    vignette: float | None = setting(
        None,
        "Darken the corners by so many stops; below 0 brighten.",
        metavar="STOPS",
        unit="stops",
        low=-10,
        high=10,
    )
    vignette_radius: float | None = setting(
        None, "With --vignette: where it begins; the corner is 1. Default 0.3.", low=0, high=2
    )
    vignette_softness: float | None = setting(
        None, "With --vignette: how much farther out it is full. Default 0.7.", low=0.01, high=2
    )
    vignette_roundness: float | None = setting(
        None, "With --vignette: 1 (the default) a circle, 0 the picture's ellipse.", low=0, high=1
    )
    vignette_color_loss: float | None = setting(
        None,
        "With --vignette, which may be 0: colour that it takes from the corners, 0 to 1 (grey).",
        low=0,
        high=1,
    )
    grain: float | None = setting(
        None,
        "Noise of a sensor of this sensitivity, such as 3200; 0 is none.",
        metavar="ISO",
        unit="ISO",
        low=0,
    )
    grain_size: float | None = setting(
        None, "With --grain: size in pixels, 0 to 50. Default 1.", unit="pixels", low=0, high=50
    )
    grain_mono: bool = setting(False, "With --grain: grey, as in film.")
    grain_seed: int | None = setting(None, "With --grain: another number, another noise. Default 0.", low=0)

    def check(self) -> None:
        """See :class:`Group`."""
        for name in field_settings(self):
            if name.startswith(("vignette_", "grain_")):
                check_needed(self, name, name.partition("_")[0])
        if self.brown is not None and self.distortion:
            raise ParameterError(
                "effects.brown",
                expected="one of `effects.distortion` and `effects.brown`",
                shown="both",
                remedy="leave one out",
            )

"""Settings of a look: aperture shape, lens aberrations, colour fringes, highlights, camera effects."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from bokehnet.errors import ParameterError
from bokehnet.settings.fields import Group, check_needed, field_settings, parse_numbers, setting

__all__ = ["ApertureSettings", "ColorSettings", "EffectSettings", "HighlightSettings", "LensSettings"]


def _gains(text: str) -> tuple[float, ...] | Path:
    """Return the numbers of a comma-separated text, or else the path of a file with such numbers."""
    try:
        return parse_numbers(text)
    except ValueError:
        return Path(text)


@dataclass(frozen=True, kw_only=True, slots=True)
class ApertureSettings(Group):
    """Shape of the aperture, which is the shape of blurred lights.

    Examples:
        >>> ApertureSettings(blades=7, rotation=15).rotation  # degrees
        15.0
        >>> ApertureSettings(blades=2)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: aperture.blades: expected 0 (disc) or 3 to 16, got 2
    """

    GROUP: ClassVar[str] = "aperture"
    TITLE: ClassVar[str] = "Aperture shape"
    ALLOWED_IN_PRESET: ClassVar[bool] = True

    blades: int = setting(
        0,
        "Number of aperture blades, 3 to 16. Default: 0, a round aperture.",
        expected="0 (disc) or 3 to 16",
        accepts=lambda count: count == 0 or 3 <= count <= 16,
    )
    curvature: float | None = setting(
        None,
        "With --blades: curvature of the blades, 0 (straight, default) to 1 (round aperture).",
        flag="blade-curvature",
        low=0,
        high=1,
    )
    rotation: float | None = setting(
        None,
        "Rotation of the blades or the aperture image, degrees counter-clockwise.",
        flag="aperture-rotation",
        unit="degrees",
    )
    squeeze: float = setting(
        1.0,
        "Aspect ratio (width over height) of the blur disc, 0.1 to 10. Below 1: upright ovals, as from "
        "anamorphic "
        "lenses.",
        low=0.1,
        high=10,
    )
    cats_eye: float = setting(
        0.0,
        "Cat's-eye clipping of the blur disc towards the corners, 0 (none) to 1.5 (strongest).",
        low=0,
        high=1.5,
    )
    image: Path | None = setting(
        None,
        "Image of the aperture seen from behind the camera, any size; bright pixels transmit light. Lights "
        "behind focus show it upright, lights in front of focus rotated by 180 degrees.",
        flag="aperture-image",
    )
    spherical_profile: float = setting(
        0.0,
        "Brightness of the rim of discs behind focus, -1 (dark) to 1 (bright). Reversed in front of focus.",
        flag="rim",
        low=-1,
        high=1,
    )
    obstruction: float = setting(
        0.0, "Central obstruction of a mirror lens, 0 to 0.95 of the disc's radius.", low=0, high=0.95
    )
    onion: float = setting(
        0.0,
        "Onion rings inside discs, as from moulded aspherical lenses, 0 (none) to 1 (strongest).",
        low=0,
        high=1,
    )
    onion_rings: float | None = setting(
        None, "With --onion: number of rings from centre to rim, 1 to 40. Default: 12.", low=1, high=40
    )
    grain: float = setting(
        0.0,
        "Texture inside discs, as from dust and uneven coating, 0 (none) to 1 (strongest).",
        flag="disc-grain",
        low=0,
        high=1,
    )
    grain_seed: int | None = setting(
        None,
        "With --disc-grain: random seed, a whole number from 0. Default: 0.",
        flag="disc-grain-seed",
        low=0,
    )

    def check(self) -> None:
        """See :class:`Group`."""
        check_needed(self, "curvature", "blades")
        check_needed(self, "rotation", "blades", "image", why="a disc has no direction")
        check_needed(self, "onion_rings", "onion")
        check_needed(self, "grain_seed", "grain")


@dataclass(frozen=True, kw_only=True, slots=True)
class LensSettings(Group):
    """Lens: a prescription to trace, and aberrations set by hand.

    Examples:
        >>> LensSettings(name="petzval", f_number=5.6).f_number
        5.6
        >>> LensSettings(f_number=5.6)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: lens.f_number: expected `lens.name` for it to act on, ...
    """

    GROUP: ClassVar[str] = "lens"
    TITLE: ClassVar[str] = "Lens and aberrations"
    ALLOWED_IN_PRESET: ClassVar[bool] = True

    name: str | None = setting(
        None,
        "Lens to render through, with all its aberrations: a name listed by `bokehnet lens`, or a lens file "
        "of bokehnet, Zemax, CODE V, OSLO, optiland or ray-optics.",
        flag="lens",
        metavar="NAME|FILE",
    )
    aberrations: Literal["traced", "seidel"] | None = setting(
        None,
        "With --lens: aberrations traced through the glass (traced, default) or by third-order theory "
        "(seidel).",
    )
    engine: Literal["map", "profile"] | None = setting(
        None,
        "With --lens: aberrations at every place of the picture (map, default), or those of the axis "
        "everywhere (profile): no cat's-eye, coma or lateral colour.",
        flag="lens-engine",
    )
    f_number: float | None = setting(
        None,
        "With --lens: f-number to stop down to. Default: --f-number, else wide open.",
        flag="lens-f-number",
        above=0,
    )
    distortion: bool = setting(
        False,
        "With --lens: apply the lens's distortion, for a picture without distortion.",
        flag="lens-distortion",
    )
    vignetting: bool = setting(
        True,
        "With --lens: apply the lens's vignetting, mechanical and natural (on by default).",
        flag="lens-vignetting",
    )
    focusing: Literal["sharpest", "paraxial"] | None = setting(
        None,
        "With --lens or --spherical: focus at the smallest blur (sharpest, default) or where rays near the "
        "axis meet (paraxial).",
    )
    copy_to_copy: float | None = setting(
        None,
        "With --lens: random misalignment of the elements as in one manufactured copy, 0 (as designed) to "
        "10. "
        "At 1: up to 0.02 mm and 0.02 degrees. `bokehnet lens copy` prints its effects.",
        low=0,
        high=10,
    )
    copy_seed: int | None = setting(
        None, "With --copy-to-copy: number of the copy, from 0. Default: 0.", low=0
    )
    table: Path | None = setting(
        None,
        "Table of aberrations by wavelength: a CSV file as written by `bokehnet lens aberrations`.",
        flag="aberration-table",
        metavar="FILE.csv",
    )
    spherical: float = setting(
        0.0,
        "Spherical aberration, percent of half the picture's diagonal: positive gives discs behind focus a "
        "bright rim (soap bubbles), negative a soft one.",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )
    coma: float = setting(
        0.0,
        "Coma, percent of half the diagonal: tails in the corners, outwards if positive, inwards if "
        "negative.",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )
    astigmatism: float = setting(
        0.0,
        "Astigmatism, percent of half the diagonal: discs behind focus swirl around the centre if positive, "
        "point to it if negative.",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )
    field_curvature: float = setting(
        0.0,
        "Field curvature, percent of half the diagonal: corners focus farther than the centre if positive, "
        "nearer if negative.",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )

    def check(self) -> None:
        """See :class:`Group`."""
        for name in ("aberrations", "engine", "distortion", "f_number", "copy_to_copy"):
            check_needed(self, name, "name")
        if self.engine == "profile" and self.distortion:
            raise ParameterError(
                "lens.distortion", "`lens.engine` map: a profile has no distortion", self.distortion
            )
        check_needed(self, "copy_seed", "copy_to_copy")
        check_needed(self, "focusing", "name", "spherical")


@dataclass(frozen=True, kw_only=True, slots=True)
class ColorSettings(Group):
    """Chromatic aberration: axial and lateral colour fringes.

    Examples:
        >>> ColorSettings(axial=0.3, glass="achromat").axial  # percent of the half-diagonal
        0.3
        >>> ColorSettings(glass="achromat")
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: color.glass: expected `color.axial` or `color.lateral` for it ...
    """

    GROUP: ClassVar[str] = "color"
    TITLE: ClassVar[str] = "Chromatic aberration"
    ALLOWED_IN_PRESET: ClassVar[bool] = True

    axial: float = setting(
        0.0,
        "Axial chromatic aberration: difference in blur between violet and red, percent of half the "
        "diagonal. "
        "Positive, as in a simple lens: red rims in front of focus, blue rims behind it.",
        flag="axial-fringe",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )
    lateral: float = setting(
        0.0,
        "Lateral chromatic aberration: outward shift of violet against red in the corners, percent of half "
        "the diagonal.",
        flag="lateral-fringe",
        metavar="PERCENT",
        unit="percent",
        low=-100,
        high=100,
    )
    axial_map: str | None = setting(
        None,
        "With --axial-fringe: strength over the picture, one or more of these joined by commas: constant "
        "(default), linear, square, cube, exponential, inversion, reciprocal, cosine, angular, power:N, "
        "angular:N.",
        metavar="NAMES",
    )
    lateral_map: str | None = setting(
        None,
        "With --lateral-fringe: strength over the picture, as in --axial-map. Default: linear.",
        metavar="NAMES",
    )
    glass: str | None = setting(
        None,
        "With a fringe: dispersion curve of a glass (default N-BK7), achromat (green against purple) or "
        "linear.",
        flag="fringe-glass",
        metavar="NAME",
    )
    dispersion: Literal["continuous", "rgb"] | None = setting(
        None, "Spectrum of fringes: continuous (default) or rgb (three wavelengths)."
    )
    equaliser: tuple[float, ...] | Path | None = setting(
        None,
        "Weights of the wavelengths in fringes, violet to red, such as 1,1,0,0,3,1,1, or a file with them.",
        metavar="GAINS",
        parse=_gains,
        low=0,
        expected="numbers from 0 up separated by commas, or a file with them",
    )

    def check(self) -> None:
        """See :class:`Group`."""
        check_needed(self, "axial_map", "axial")
        check_needed(self, "lateral_map", "lateral")
        check_needed(self, "glass", "axial", "lateral")


def _word_or_number(text: str) -> str | float:
    """Return a text as it is if it is a word of ``--highlights``, otherwise its number."""
    return text if text in ("auto", "off") else float(text)


@dataclass(frozen=True, kw_only=True, slots=True)
class HighlightSettings(Group):
    """Treatment of bright light before the blur.

    Examples:
        >>> HighlightSettings(threshold=0.8, gain=6).gain  # what white becomes
        6.0
        >>> HighlightSettings(gain=6)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: highlights.gain: expected a number as `highlights.threshold` ...
    """

    GROUP: ClassVar[str] = "highlights"
    TITLE: ClassVar[str] = "Highlights"
    ALLOWED_IN_PRESET: ClassVar[bool] = True

    threshold: float | Literal["auto", "off"] = setting(
        "auto",
        "Clipped lights: auto (default) estimates their light in photographs, not in EXR or HDR files; off; "
        "or a threshold in linear light, 0 to below 1, above which pixels are brightened before the blur.",
        flag="highlights",
        metavar="auto|off|THRESHOLD",
        low=0,
        below=1,
        expected="auto, off, or at least 0 and below 1",
        parse=_word_or_number,
    )
    strength: float = setting(
        1.0,
        "With --highlights auto: factor on the estimated light above white, 0 to 4. Default: 1.",
        flag="highlight-strength",
        metavar="FACTOR",
        low=0,
        high=4,
    )
    gain: float | None = setting(
        None,
        "With a threshold for --highlights: linear light that white is expanded to, at least 1. Default: 8.",
        flag="highlight-gain",
        metavar="GAIN",
        low=1,
    )
    gamma: float = setting(
        1.0,
        "Exponent applied to light before blurring and undone after, 0.2 to 5. Above 1 emphasises bright "
        "pixels; 1 (default) is physically correct.",
        low=0.2,
        high=5,
    )

    def check(self) -> None:
        """See :class:`Group`."""
        if self.gain is not None and isinstance(self.threshold, str):
            raise ParameterError(
                "highlights.gain",
                expected="a number as `highlights.threshold` for it to act on",
                got=self.gain,
                remedy="give one, or leave this out",
            )
        if self.strength != 1 and self.threshold != "auto":
            raise ParameterError(
                "highlights.strength",
                expected="`highlights.threshold` auto for it to act on",
                got=self.strength,
                remedy="leave one out",
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class EffectSettings(Group):
    """Camera effects on the blurred picture: distortion, vignetting, grain.

    Examples:
        >>> EffectSettings(vignette=0.7, grain=1600).vignette  # stops
        0.7
        >>> EffectSettings(distortion=-0.03, brown=(0.1, 0.02))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: effects.brown: expected one of `effects.distortion` and ...
    """

    GROUP: ClassVar[str] = "effects"
    TITLE: ClassVar[str] = "Camera effects on the blurred picture"
    ALLOWED_IN_PRESET: ClassVar[bool] = True

    distortion: float = setting(
        0.0,
        "Distortion as the relative shift of the corners: -0.1 moves them inwards by 10 % (barrel), positive "
        "values outwards (pincushion).",
        low=-0.9,
        high=0.9,
    )
    brown: tuple[float, ...] | None = setting(
        None,
        "Distortion coefficients of the Brown-Conrady model, for radii in units of half the diagonal.",
        flag="distortion-brown",
        metavar="K1[,K2[,K3[,P1,P2]]]",
        parse=parse_numbers,
        expected="finite K1[,K2[,K3[,P1,P2]]] such as -0.1,0.02",
        accepts=lambda numbers: len(numbers) in (1, 2, 3, 5),
    )
    cos4: float = setting(
        0.0,
        "Natural vignetting by the cos^4 law: half the diagonal angle of view, degrees, 0 to 80.",
        metavar="DEGREES",
        unit="degrees",
        low=0,
        high=80,
    )
    optical_vignetting: float = setting(
        0.0,
        "Vignetting by the lens barrel, 0 (none) to 1.5: light that --cats-eye of the same value removes.",
        low=0,
        high=1.5,
    )
    vignette: float | None = setting(
        None,
        "Darkening of the corners in stops; negative brightens.",
        metavar="STOPS",
        unit="stops",
        low=-10,
        high=10,
    )
    vignette_radius: float | None = setting(
        None, "With --vignette: radius at which it begins; the corner is at 1. Default: 0.3.", low=0, high=2
    )
    vignette_softness: float | None = setting(
        None, "With --vignette: width of the transition to full strength. Default: 0.7.", low=0.01, high=2
    )
    vignette_roundness: float | None = setting(
        None, "With --vignette: shape, 1 (circle, default) to 0 (ellipse of the frame).", low=0, high=1
    )
    vignette_color_loss: float | None = setting(
        None,
        "With --vignette (0 is allowed): desaturation of the corners, 0 (none, default) to 1 (grey).",
        low=0,
        high=1,
    )
    grain: float | None = setting(
        None,
        "Noise of a sensor at this ISO sensitivity, such as 3200; 0 is none.",
        metavar="ISO",
        unit="ISO",
        low=0,
    )
    grain_size: float | None = setting(
        None, "With --grain: grain size in pixels, 0 to 50. Default: 1.", unit="pixels", low=0, high=50
    )
    grain_mono: bool = setting(False, "With --grain: monochrome grain, as in film.")
    grain_seed: int | None = setting(None, "With --grain: random seed. Default: 0.", low=0)

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

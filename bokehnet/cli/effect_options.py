"""What the camera does to the blurred picture: options of ``bokehnet render`` and what is made of them."""

from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.cli.naming import named_options
from bokehnet.errors import ParameterError

if TYPE_CHECKING:
    from bokehnet.effects import BrownConrady, CameraEffects, Grain, Vignette

__all__ = [
    "Cos4",
    "DistortionBrown",
    "DistortionStrength",
    "GrainIso",
    "GrainMono",
    "GrainSeed",
    "GrainSize",
    "OpticalVignetting",
    "VignetteRadius",
    "VignetteRoundness",
    "VignetteSoftness",
    "VignetteStops",
    "make_effects",
]

DistortionStrength = Annotated[
    float,
    typer.Option(
        "--distortion", help="How far the corner moves: -0.1 inwards by 10 % (barrel), above 0 outwards."
    ),
]
DistortionBrown = Annotated[
    str | None,
    typer.Option(
        metavar="K1[,K2[,K3[,P1,P2]]]",
        help="Distortion by Brown and Conrady, for radii in half-diagonals of the picture.",
    ),
]
Cos4 = Annotated[
    float,
    typer.Option(
        metavar="DEGREES", help="Darken by the cos^4 law; half the view across the diagonal, 0 to 80."
    ),
]
OpticalVignetting = Annotated[
    float, typer.Option(help="Darken by what the barrel cuts off in the corners, 0 to 1.5, as --cats-eye.")
]
VignetteStops = Annotated[
    float | None,
    typer.Option(
        "--vignette", metavar="STOPS", help="Darken the corners by so many stops; below 0 brighten."
    ),
]
VignetteRadius = Annotated[
    float | None,
    typer.Option(help="With --vignette: where it begins; the corner is 1. Default 0.3."),
]
VignetteSoftness = Annotated[
    float | None, typer.Option(help="With --vignette: how much farther out it is full. Default 0.7.")
]
VignetteRoundness = Annotated[
    float | None, typer.Option(help="With --vignette: 1 (the default) a circle, 0 the picture's ellipse.")
]
GrainIso = Annotated[
    float | None,
    typer.Option(
        "--grain", metavar="ISO", help="Noise of a sensor of this sensitivity, such as 3200; 0 is none."
    ),
]
GrainSize = Annotated[float | None, typer.Option(help="With --grain: size in pixels, 0 to 50. Default 1.")]
GrainMono = Annotated[bool, typer.Option("--grain-mono", help="With --grain: grey, as in film.")]
GrainSeed = Annotated[
    int | None, typer.Option(help="With --grain: another number, another noise. Default 0.")
]


def make_effects(
    *,
    distortion: float = 0.0,
    brown: str | None = None,
    cos4: float = 0.0,
    optical_vignetting: float = 0.0,
    vignette: float | None = None,
    radius: float | None = None,
    softness: float | None = None,
    roundness: float | None = None,
    iso: float | None = None,
    size: float | None = None,
    mono: bool = False,
    seed: int | None = None,
) -> "CameraEffects | None":
    """Return the effects that the options describe; None where there are none.

    Raises:
        ParameterError: A number is out of range, or an option has nothing to act on.
    """
    shape = {"radius": radius, "softness": softness, "roundness": roundness}
    kind = {"size": size, "seed": seed, "mono": mono or None}
    for parent, value, options in (("vignette", vignette, shape), ("grain", iso, kind)):
        if value is None and (given := [name for name, number in options.items() if number is not None]):
            raise ParameterError(f"--{parent}-{given[0]} needs --{parent}")
    if brown is not None and distortion != 0:
        raise ParameterError("expected one of --distortion and --distortion-brown, found both")
    if not (distortion or brown or cos4 or optical_vignetting or vignette or iso):
        return None
    from bokehnet.effects import CameraEffects, DivisionModel  # after parsing, so --help stays fast

    with named_options({"strength": "--distortion"}):
        division = DivisionModel(strength=distortion) if distortion else None
    polynomial = None if brown is None else _parse_brown(brown)
    with named_options({"cos4": "--cos4", "optical_vignetting": "--optical-vignetting"}):
        effects = CameraEffects(
            distortion=division or polynomial,
            cos4=cos4,
            optical_vignetting=optical_vignetting,
            vignette=_make_vignette(vignette, shape) if vignette else None,
            grain=_make_grain(iso, size, mono, seed) if iso else None,
        )
    return None if effects == CameraEffects() else effects


def _parse_brown(text: str) -> "BrownConrady | None":
    """The model of K1[,K2[,K3[,P1,P2]]]; None where all are 0."""
    from bokehnet.effects import BrownConrady, Warp

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2, 3, 5):
        raise ParameterError(
            f"--distortion-brown: expected K1[,K2[,K3[,P1,P2]]] such as -0.1,0.02, got {text!r}"
        )
    k1, k2, k3, p1, p2 = [*numbers, *[0.0] * (5 - len(numbers))]
    with named_options(dict.fromkeys(("distortion", "radial", "decentring"), "--distortion-brown")):
        model = BrownConrady(radial=(k1, k2, k3), decentring=(p1, p2))
        Warp(distortion=model).check()
    return model if any(numbers) else None


def _make_vignette(stops: float, shape: dict[str, float | None]) -> "Vignette":
    from bokehnet.effects import Vignette

    options = {name: f"--vignette-{name}" for name in shape} | {"stops": "--vignette"}
    with named_options(options):
        return Vignette(stops=stops, **{name: value for name, value in shape.items() if value is not None})


def _make_grain(iso: float, size: float | None, mono: bool, seed: int | None) -> "Grain":
    from bokehnet.effects import Grain

    options = {"iso": "--grain", "size": "--grain-size", "seed": "--grain-seed"}
    with named_options(options):
        return Grain(iso=iso, size=1.0 if size is None else size, monochrome=mono, seed=seed or 0)

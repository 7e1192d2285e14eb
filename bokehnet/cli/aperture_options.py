"""The shape of the lens opening: options of ``bokehnet render`` and what is made of them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.cli.naming import named_options
from bokehnet.errors import ParameterError

if TYPE_CHECKING:
    from bokehnet.optics.aperture import Aperture

__all__ = [
    "ApertureImage",
    "ApertureRotation",
    "BladeCurvature",
    "Blades",
    "CatsEye",
    "DiscGrain",
    "DiscGrainSeed",
    "Obstruction",
    "Onion",
    "OnionRings",
    "Rim",
    "Squeeze",
    "read_aperture",
]

Blades = Annotated[int, typer.Option(help="Blades of the aperture, 3 to 16; 0 is a disc.")]
BladeCurvature = Annotated[
    float | None, typer.Option(help="With --blades: 0 (straight, the default) to 1 (disc).")
]
ApertureRotation = Annotated[
    float | None, typer.Option(help="Turn of blades or aperture image, degrees counter-clockwise.")
]
Squeeze = Annotated[
    float, typer.Option(help="Width over height of the blur disc, 0.1 to 10; below 1 for anamorphic ovals.")
]
CatsEye = Annotated[
    float, typer.Option(help="Clipping of the blur disc in the corners of the picture, 0 to 1.5.")
]
ApertureImage = Annotated[
    Path | None, typer.Option(help="Picture of the opening, bright where light passes; any size.")
]
Rim = Annotated[
    float,
    typer.Option(help="Light at the rim of discs behind focus, -1 (dark) to 1 (bright); else reversed."),
]
Obstruction = Annotated[
    float, typer.Option(help="Radius of the dark core of a mirror lens, 0 to 0.95 of the disc.")
]
Onion = Annotated[
    float, typer.Option(help="Rings inside discs, as machined lenses draw them, 0 to 1 (strongest).")
]
OnionRings = Annotated[
    float | None, typer.Option(help="With --onion: rings from middle to rim, 1 to 40; default 12.")
]
DiscGrain = Annotated[float, typer.Option(help="Dust and uneven coating inside discs, 0 to 1 (strongest).")]
DiscGrainSeed = Annotated[
    int | None, typer.Option(help="With --disc-grain: which grain, a whole number from 0 up.")
]

_OPTIONS = {
    "blades": "--blades",
    "curvature": "--blade-curvature",
    "rotation": "--aperture-rotation",
    "squeeze": "--squeeze",
    "cats_eye": "--cats-eye",
    "spherical_profile": "--rim",
    "obstruction": "--obstruction",
    "aperture picture": "--aperture-image",
    "onion": "--onion",
    "onion_rings": "--onion-rings",
    "grain": "--disc-grain",
    "grain_seed": "--disc-grain-seed",
}


def read_aperture(
    *,
    blades: int,
    curvature: float | None,
    rotation: float | None,
    squeeze: float,
    cats_eye: float,
    image: Path | None,
    rim: float,
    obstruction: float,
    onion: float = 0.0,
    onion_rings: float | None = None,
    grain: float = 0.0,
    grain_seed: int | None = None,
) -> "Aperture":
    """Return the aperture that the options describe; ``None`` where one was left out.

    Raises:
        ParameterError: A number is out of range, or an option has nothing to act on.
        ImageFileError: The picture cannot be read.
    """
    if curvature is not None and not blades:
        raise ParameterError("--blade-curvature needs --blades")
    if rotation is not None and not blades and image is None:
        raise ParameterError(
            "--aperture-rotation needs --blades or --aperture-image; a disc has no direction"
        )
    if onion_rings is not None and not onion:
        raise ParameterError("--onion-rings needs --onion")
    if grain_seed is not None and not grain:
        raise ParameterError("--disc-grain-seed needs --disc-grain")
    from bokehnet.io.color import luminance  # after parsing, so --help stays fast
    from bokehnet.io.image import read_image
    from bokehnet.optics.aperture import Aperture

    picture = None if image is None else luminance(read_image(image))
    with named_options(_OPTIONS):
        return Aperture(
            blades=blades,
            curvature=curvature or 0.0,
            rotation=rotation or 0.0,
            squeeze=squeeze,
            cats_eye=cats_eye,
            spherical_profile=rim,
            obstruction=obstruction,
            picture=picture,
            onion=onion,
            onion_rings=12.0 if onion_rings is None else onion_rings,
            grain=grain,
            grain_seed=grain_seed or 0,
        )

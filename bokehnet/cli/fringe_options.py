"""Colour fringes: options of ``bokehnet render`` and what is made of them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.cli.engine_option import RAY_ENGINES
from bokehnet.cli.naming import named_options
from bokehnet.errors import ConfigError, LensError, ParameterError

if TYPE_CHECKING:
    from bokehnet.optics.chromatic_aberration import ChromaticAberration
    from bokehnet.optics.wavelength_sampling import WavelengthSampling

__all__ = [
    "AxialFringe",
    "AxialMap",
    "Dispersion",
    "Equaliser",
    "FringeGlass",
    "LateralFringe",
    "LateralMap",
    "check_fringes",
    "make_fringes",
    "make_light",
]

AxialFringe = Annotated[
    float,
    typer.Option(
        metavar="PERCENT",
        help="Blur that colours differ by, violet to red, percent of the half-diagonal; "
        "above 0 as in a simple lens: red rims in front of focus, blue rims behind it.",
    ),
]
LateralFringe = Annotated[
    float,
    typer.Option(
        metavar="PERCENT",
        help="How far violet lies outwards of red in the corners, percent of the half-diagonal.",
    ),
]
AxialMap = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help="With --axial-fringe: its factor over the picture, names joined by commas: constant (default), "
        "linear, square, cube, exponential, inversion, reciprocal, cosine, angular, power:N, angular:N.",
    ),
]
LateralMap = Annotated[
    str | None, typer.Option(metavar="NAMES", help="With --lateral-fringe: the same; default linear.")
]
FringeGlass = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="What parts the colours: a glass (default N-BK7), achromat (green from purple) or linear.",
    ),
]
Dispersion = Annotated[
    str | None, typer.Option(help="Colours of fringes: continuous (default), or rgb: three alone.")
]
Equaliser = Annotated[
    str | None,
    typer.Option(
        metavar="GAINS",
        help="Weights of the colours in fringes, violet to red, such as 1,1,0,0,3,1,1; or a file of them.",
    ),
]

_FRINGE_OPTIONS = {"axial": "--axial-fringe", "lateral": "--lateral-fringe"}
_LIGHT_OPTIONS = {"dispersion": "--dispersion", "equaliser": "--equaliser"}

# Bytes of a file with gains; nobody has more.
_LONGEST_FILE = 10_000


def make_fringes(
    *,
    axial: float = 0.0,
    lateral: float = 0.0,
    axial_map: str | None = None,
    lateral_map: str | None = None,
    glass: str | None = None,
) -> "ChromaticAberration | None":
    """Return the fringes that the options describe; ``None`` where both strengths are 0.

    Raises:
        ParameterError: A number is out of range, a name is unknown, or an option has nothing to act on.
    """
    if axial_map is not None and axial == 0:
        raise ParameterError("--axial-map needs --axial-fringe")
    if lateral_map is not None and lateral == 0:
        raise ParameterError("--lateral-map needs --lateral-fringe")
    if axial == lateral == 0:
        if glass is not None:
            raise ParameterError("--fringe-glass needs --axial-fringe or --lateral-fringe")
        return None
    from bokehnet.optics.chromatic_aberration import ChromaticAberration, make_curve
    from bokehnet.optics.field_maps import make_field_map  # after parsing, so --help stays fast

    with named_options({"field map": "--axial-map"}):
        first = make_field_map(axial_map or "constant")
    with named_options({"field map": "--lateral-map"}):
        second = make_field_map(lateral_map or "linear")
    try:
        curve = make_curve(glass or "N-BK7")
    except LensError as error:
        known = str(error).partition("; others")[0]
        raise ParameterError(f"--fringe-glass: {known}; or achromat, linear") from error
    with named_options(_FRINGE_OPTIONS):
        return ChromaticAberration(
            axial=axial, lateral=lateral, axial_map=first, lateral_map=second, curve=curve
        )


def make_light(dispersion: str | None = None, equaliser: str | None = None) -> "WavelengthSampling":
    """Return the draw of wavelengths that the options describe.

    Args:
        dispersion: See :class:`bokehnet.optics.wavelength_sampling.WavelengthSampling`; ``None`` is
            continuous.
        equaliser: Gains separated by commas, or the path of a text file with gains separated by commas,
            spaces or line ends; ``None`` is flat.

    Raises:
        ParameterError: An unknown dispersion, or gains that cannot be used.
        ConfigError: A file that holds no gains.
    """
    from bokehnet.optics.wavelength_sampling import WavelengthSampling

    gains = (1.0,) if equaliser is None else _read_gains(equaliser)
    with named_options(_LIGHT_OPTIONS):
        return WavelengthSampling(dispersion=dispersion or "continuous", equaliser=gains)


def check_fringes(
    fringes: "ChromaticAberration | None",
    light: "WavelengthSampling",
    *,
    engine: str,
    through_glass: bool = False,
) -> None:
    """Raise ``ParameterError`` where fringes meet an engine that knows none, or light has none to color.

    Args:
        fringes: Of the options.
        light: Likewise.
        engine: What renders.
        through_glass: Whether there is a lens that may part the colours.
    """
    engines = " or ".join(RAY_ENGINES)
    if fringes is not None and engine not in RAY_ENGINES:
        raise ParameterError(f"--axial-fringe, --lateral-fringe: expected --engine {engines}, got {engine}")
    if light != type(light)() and fringes is None and not through_glass:
        raise ParameterError(
            "--dispersion and --equaliser need colours that part: --axial-fringe, --lateral-fringe or --lens"
        )


def _read_gains(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        pass
    path = Path(text)
    if not path.exists():
        raise ParameterError(
            f"--equaliser: expected numbers separated by commas, or a file of them, got {text!r}"
        )
    try:
        with path.open(encoding="utf-8-sig") as file:
            words = file.read(_LONGEST_FILE).replace(",", " ").split()
        return tuple(float(word) for word in words)
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror or error}") from error
    except ValueError as error:  # no number, or no text
        raise ConfigError(
            f"{path}: expected numbers separated by commas, spaces or line ends: {error}"
        ) from error

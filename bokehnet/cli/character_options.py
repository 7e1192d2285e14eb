"""The character of the lens: options of ``bokehnet render`` and what is made of them."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from bokehnet.cli.engine_option import RAY_ENGINES
from bokehnet.cli.fringe_options import check_fringes
from bokehnet.cli.naming import named_options
from bokehnet.errors import LensError, ParameterError

if TYPE_CHECKING:
    from bokehnet.cli.focus import Focus
    from bokehnet.cli.scene_map import SceneMap
    from bokehnet.lenses.prescription import PrescriptionLens
    from bokehnet.optics.aberration_map import AberrationMap
    from bokehnet.optics.chromatic_aberration import ChromaticAberration
    from bokehnet.optics.lens_response import LensResponse
    from bokehnet.optics.wavelength_sampling import WavelengthSampling

__all__ = [
    "Aberrations",
    "Astigmatism",
    "ChosenLens",
    "Coma",
    "FieldCurvature",
    "LensDistortion",
    "LensFNumber",
    "LensName",
    "Spherical",
    "choose_lens",
    "make_character",
]

LensName = Annotated[
    str | None,
    typer.Option(
        "--lens",
        metavar="NAME|FILE.toml",
        help="Render through this lens, with all its aberrations; bokehnet lens lists them.",
    ),
]
Aberrations = Annotated[
    str | None,
    typer.Option(
        metavar="traced|seidel",
        help="With --lens: traced through its glass (default), or by third-order theory.",
    ),
]
LensFNumber = Annotated[
    float | None,
    typer.Option(help="With --lens: stop it down to this; default: --f-number, else fully open."),
]
LensDistortion = Annotated[
    bool,
    typer.Option("--lens-distortion", help="With --lens: bend a picture without distortion as it does."),
]
Spherical = Annotated[
    float,
    typer.Option(
        metavar="PERCENT",
        help="Blur by the rim of the lens: above 0 discs behind focus get a bright rim (soap bubbles), "
        "below 0 they fade out. These four in percent of half the picture's diagonal.",
    ),
]
Coma = Annotated[
    float,
    typer.Option(metavar="PERCENT", help="Tails in the corners: above 0 outwards, below 0 inwards."),
]
Astigmatism = Annotated[
    float,
    typer.Option(
        metavar="PERCENT",
        help="Above 0 discs behind focus swirl around the middle, below 0 they point to it.",
    ),
]
FieldCurvature = Annotated[
    float,
    typer.Option(
        metavar="PERCENT",
        help="Above 0 the corners focus farther away than the middle, below 0 nearer.",
    ),
]

_SLIDERS = {
    "spherical": "--spherical",
    "coma": "--coma",
    "astigmatism": "--astigmatism",
    "field_curvature": "--field-curvature",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class ChosenLens:
    """A prescription to render through, before the frame is known.

    Attributes:
        name: In the catalog, or the path of a TOML file.
        theory: Whether by third-order theory in place of traced rays.
        distortion: Whether the picture is bent, too.
        f_number: None takes that of the camera, else the lens is fully open.
    """

    name: str
    theory: bool = False
    distortion: bool = False
    f_number: float | None = None

    def pencil(self, focus: "Focus", scene: "SceneMap") -> "AberrationMap":
        """Return what the lens does to the rays of one picture.

        With metric depth the lens is scaled to the camera's focal length, focused where the camera is, and
        its sensor is the camera's. With relative disparity it is the lens as designed, focused at infinity.

        Raises:
            ParameterError: As :meth:`Focus.defocus`.
            LensError: The lens cannot do what the camera does.
        """
        from bokehnet.lenses.aberration_cache import cached_aberration_map
        from bokehnet.lenses.seidel_lens import seidel_aberration_map

        half_diagonal, camera, distance = None, focus, math.inf
        if scene.metric:
            camera, nearness = focus.complete(scene)
            distance = 1 / nearness if nearness > 0 else math.inf
            assert camera.sensor_width is not None
            window = scene.window
            half_diagonal = (
                0.5 * camera.sensor_width * math.hypot(1, window.display_height / window.display_width)
            )
        make = seidel_aberration_map if self.theory else cached_aberration_map
        lens = self.load(camera.focal_length, camera.f_number, distance)
        try:
            return make(lens, half_diagonal=half_diagonal, distortion=self.distortion)
        except LensError as error:
            raise LensError(f"--lens: {error}") from error

    def load(
        self, focal_length: float | None = None, f_number: float | None = None, distance: float = math.inf
    ) -> "PrescriptionLens":
        """Return the lens at work; lengths in mm, None is as designed.

        Raises:
            LensError: There is no such lens, or it cannot do this.
            ConfigError: Its file is missing or wrong.
        """
        from bokehnet.lenses.catalog import load_lens

        try:
            return load_lens(
                self.name,
                focal_length=focal_length,
                f_number=f_number if self.f_number is None else self.f_number,
                focus_distance=distance,
            )
        except LensError as error:
            hint = "; --lens-f-number sets it for the lens alone" if "f-number" in str(error) else ""
            raise LensError(f"--lens: {error}{hint if self.f_number is None else ''}") from error


def choose_lens(
    name: str | None,
    *,
    aberrations: str | None = None,
    distortion: bool = False,
    f_number: float | None = None,
) -> ChosenLens | None:
    """Return the lens that the options describe; ``None`` where none is named.

    Raises:
        ParameterError: An option has no lens to act on, or its value is unknown.
        LensError: There is no such lens, or it does not open so far.
        ConfigError: Its file is missing or wrong.
    """
    if name is None:
        given = {
            "--aberrations": aberrations is not None,
            "--lens-distortion": distortion,
            "--lens-f-number": f_number is not None,
        }
        if wrong := [option for option, used in given.items() if used]:
            raise ParameterError(f"{' and '.join(wrong)}: expected a lens to go with, found no --lens")
        return None
    from bokehnet.checks import check_choice  # after parsing, so --help stays fast

    check_choice("--aberrations", aberrations or "traced", ("traced", "seidel"))
    lens = ChosenLens(name=name, theory=aberrations == "seidel", distortion=distortion, f_number=f_number)
    lens.load()
    return lens


def make_character(
    *,
    engine: str,
    lens: ChosenLens | None = None,
    spherical: float = 0.0,
    coma: float = 0.0,
    astigmatism: float = 0.0,
    field_curvature: float = 0.0,
    fringes: "ChromaticAberration | None" = None,
    light: "WavelengthSampling | None" = None,
) -> "LensResponse | None":
    """Return the character that all frames share; ``None`` for a perfect lens.

    Args:
        engine: What renders.
        lens: Lens of the prescription, whose own aberration map depends on the frame:
            :meth:`ChosenLens.pencil`.
        spherical: See :class:`bokehnet.optics.sliders.AberrationSliders`, as the next three.
        coma: Likewise.
        astigmatism: Likewise.
        field_curvature: Likewise.
        fringes: Chromatic aberration by sliders.
        light: Which wavelengths stand for the light; ``None`` is the default.

    Raises:
        ParameterError: A number is out of range, the engine sends no rays through lenses, or light is told
            to part where nothing parts it.
    """
    from bokehnet.optics.sliders import AberrationSliders

    with named_options(_SLIDERS):
        sliders = AberrationSliders(
            spherical=spherical, coma=coma, astigmatism=astigmatism, field_curvature=field_curvature
        )
    given = [option for name, option in _SLIDERS.items() if getattr(sliders, name)]
    if lens is not None:
        given = ["--lens", *given]
    if given and engine not in RAY_ENGINES:
        raise ParameterError(
            f"{', '.join(given)}: expected --engine {' or '.join(RAY_ENGINES)}, which follow rays through "
            f"a lens, got {engine}"
        )
    from bokehnet.optics.lens_response import LensResponse
    from bokehnet.optics.wavelength_sampling import WavelengthSampling

    if light is None:
        light = WavelengthSampling()
    check_fringes(fringes, light, engine=engine, through_glass=lens is not None)
    if not given and fringes is None and light == WavelengthSampling():
        return None
    return LensResponse(
        aberration_map=sliders.aberration_map(), chromatic_aberration=fringes, wavelength_sampling=light
    )

"""Conversion of look settings to aperture, lens response, highlights and camera effects."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from bokehnet.effects import BrownConrady, CameraEffects, DivisionModel, Grain, Vignette, Warp
from bokehnet.errors import ConfigError, LensError, ParameterError, errors_of_file
from bokehnet.io.color.srgb import luminance
from bokehnet.io.files.text import read_text
from bokehnet.io.image import read_image
from bokehnet.io.window import Window
from bokehnet.lenses.aberrations.aberration_cache import cached_aberration_map
from bokehnet.lenses.aberrations.aberration_table import parse_aberration_table
from bokehnet.lenses.aberrations.relative_illumination import relative_illumination
from bokehnet.lenses.seidel_lens import seidel_aberration_map
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration, make_curve
from bokehnet.optics.aberrations.field_maps import make_field_map
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling
from bokehnet.optics.tone import Highlights
from bokehnet.scene.focus import FocusedLens
from bokehnet.scene.prescription import lens_of_picture
from bokehnet.settings.error_names import errors_named_as
from bokehnet.settings.fields import Group
from bokehnet.settings.settings import (
    ApertureSettings,
    ColorSettings,
    EffectSettings,
    HighlightSettings,
    LensSettings,
)

__all__ = [
    "make_aperture",
    "make_effects",
    "make_highlights",
    "make_lens_response",
    "picture_aberrations",
    "picture_shading",
]

# Maximum number of characters of a file with gains and of a table of aberrations.
_MAX_GAINS_CHARACTERS, _MAX_TABLE_CHARACTERS = 10_000, 4_000_000
# Minimum light in corners outside the image circle, relative to the centre.
_MIN_CORNER_LIGHT = 1e-3


def make_aperture(settings: ApertureSettings) -> Aperture:
    """Return the aperture.

    Raises:
        ParameterError: The aperture is empty.
        ImageFileError: Its image cannot be read.

    Examples:
        >>> aperture = make_aperture(ApertureSettings(blades=7, squeeze=0.5))
        >>> aperture.blades, aperture.squeeze, aperture.curvature  # straight blades
        (7, 0.5, 0.0)
    """
    picture = None if settings.image is None else luminance(read_image(settings.image))
    with errors_named_as("aperture", {"picture": "image"}):
        return Aperture(picture=picture, **_matching_fields(settings, Aperture))


def _matching_fields(settings: Group, kind: type, prefix: str = "") -> dict[str, Any]:
    """Return the set values of settings with the names of fields of ``kind``, after a prefix."""
    values = {item.name: getattr(settings, prefix + item.name, None) for item in fields(kind)}
    return {name: value for name, value in values.items() if value is not None}


def make_highlights(settings: HighlightSettings) -> Highlights | None:
    """Return the expansion of lights above a threshold; None without a threshold.

    Examples:
        >>> import numpy as np
        >>> lights = make_highlights(HighlightSettings(threshold=0.8, gain=4))
        >>> lights.expand(np.array([[0.5] * 3, [1.0] * 3])).tolist()  # grey stays, white becomes 4
        [[0.5, 0.5, 0.5], [4.0, 4.0, 4.0]]
    """
    if isinstance(settings.threshold, str):
        return None
    gain = {} if settings.gain is None else {"gain": settings.gain}
    return Highlights(threshold=settings.threshold, **gain)


def make_effects(settings: EffectSettings) -> CameraEffects | None:
    """Return the effects of the camera on the blurred picture; None without any.

    Raises:
        ParameterError: The distortion folds over itself.

    Examples:
        >>> import numpy as np
        >>> effects = make_effects(EffectSettings(vignette=1))  # stop
        >>> exposed = effects.apply(np.ones((24, 32, 3), np.float32))
        >>> round(float(exposed[12, 16, 0]), 1), round(float(exposed[0, 0, 0]), 1)  # centre, corner
        (1.0, 0.5)
    """
    division = DivisionModel(strength=settings.distortion) if settings.distortion else None
    effects = CameraEffects(
        distortion=division or _brown_conrady(settings.brown),
        cos4=settings.cos4,
        optical_vignetting=settings.optical_vignetting,
        vignette=_vignette(settings) if settings.vignette or settings.vignette_color_loss else None,
        grain=_grain(settings) if settings.grain else None,
    )
    return None if effects == CameraEffects() else effects


def _brown_conrady(numbers: tuple[float, ...] | None) -> BrownConrady | None:
    """Return the model with k1, k2, k3, p1, p2; None if all are 0."""
    if numbers is None or not any(numbers):
        return None
    k1, k2, k3, p1, p2 = [*numbers, *[0.0] * (5 - len(numbers))]
    with errors_named_as("effects", dict.fromkeys(("distortion", "radial", "decentring"), "brown")):
        model = BrownConrady(radial=(k1, k2, k3), decentring=(p1, p2))
        Warp(distortion=model).check()
    return model


def _vignette(settings: EffectSettings) -> Vignette:
    options = _matching_fields(settings, Vignette, "vignette_")
    with errors_named_as("effects", {"stops": "vignette", **{name: f"vignette_{name}" for name in options}}):
        return Vignette(stops=settings.vignette, **options)


def _grain(settings: EffectSettings) -> Grain:
    assert settings.grain is not None
    options = _matching_fields(settings, Grain, "grain_")
    with errors_named_as("effects", {"iso": "grain", **{name: f"grain_{name}" for name in options}}):
        return Grain(iso=settings.grain, monochrome=settings.grain_mono, **options)


def make_lens_response(lens: LensSettings, color: ColorSettings) -> LensResponse:
    """Return the lens response common to all pictures; :func:`picture_aberrations` adds that of the glass.

    Raises:
        ParameterError: A name is unknown, or a file of gains is missing.
        ConfigError: A file contains no gains, or no table of aberrations.

    Examples:
        >>> response = make_lens_response(LensSettings(coma=2), ColorSettings(lateral=0.5))  # percent
        >>> response.aberration_map.is_perfect, response.chromatic_aberration.lateral
        (False, 0.5)
    """
    with errors_named_as("lens"):
        aberrations = AberrationSliders(**_matching_fields(lens, AberrationSliders)).aberration_map()
    if lens.table is not None:
        text = read_text(lens.table, "aberrations", "a table", max_characters=_MAX_TABLE_CHARACTERS)
        with errors_of_file(lens.table, "a table of aberrations", ConfigError):
            aberrations = aberrations + parse_aberration_table(text, lens.table)
    return LensResponse(
        aberration_map=aberrations,
        chromatic_aberration=_chromatic_aberration(color),
        wavelength_sampling=_wavelength_sampling(color),
    )


def _chromatic_aberration(color: ColorSettings) -> ChromaticAberration | None:
    """Return the chromatic aberration of the sliders; None if both strengths are 0."""
    if color.axial == color.lateral == 0:
        return None
    with errors_named_as("color", {"field_map": "axial_map"}):
        axial = make_field_map(color.axial_map or "constant")
    with errors_named_as("color", {"field_map": "lateral_map"}):
        lateral = make_field_map(color.lateral_map or "linear")
    try:
        curve = make_curve(color.glass or "N-BK7")
    except LensError as error:
        known = str(error).partition("; others")[0]
        raise ParameterError("color.glass", remedy=f"{known}; or achromat, linear") from error
    with errors_named_as("color"):
        return ChromaticAberration(
            axial=color.axial, lateral=color.lateral, axial_map=axial, lateral_map=lateral, curve=curve
        )


def _wavelength_sampling(color: ColorSettings) -> WavelengthSampling:
    """Return the wavelengths that sample the light."""
    gains = color.equaliser
    if isinstance(gains, Path):
        gains = _read_gains(gains)
    with errors_named_as("color"):
        return WavelengthSampling(
            dispersion=color.dispersion or "continuous", equaliser=(1.0,) if gains is None else gains
        )


def _read_gains(path: Path) -> tuple[float, ...]:
    if not path.exists():
        raise ParameterError(
            "color.equaliser", expected="numbers separated by commas, or a file with them", got=str(path)
        )
    expected = "numbers separated by commas, spaces or line ends"
    words = read_text(path, expected=expected, max_characters=_MAX_GAINS_CHARACTERS).replace(",", " ").split()
    try:
        return tuple(float(word) for word in words)
    except ValueError as error:
        raise ConfigError(f"{path}: expected {expected}: {error}") from error


def picture_aberrations(settings: LensSettings, focused: FocusedLens, window: Window) -> AberrationMap | None:
    """Return the aberrations of one picture: those of the glass and of a tilted plane of focus.

    Arguments and errors are those of :func:`bokehnet.scene.prescription.lens_of_picture`.

    Examples:
        >>> window = Window.whole(32, 24)
        >>> focused = FocusedLens(near=0.5, far=0.5, blur=8, camera=None, plane=None, window=window)
        >>> glass = picture_aberrations(LensSettings(name="petzval", aberrations="seidel"), focused, window)
        >>> glass.is_perfect, picture_aberrations(LensSettings(), focused, window)
        (False, None)
    """
    tilt = focused.aberration_map()
    glass = lens_of_picture(settings, focused, window)
    if glass is None:
        return tilt
    lens, half_diagonal = glass
    make = seidel_aberration_map if settings.aberrations == "seidel" else cached_aberration_map
    try:
        aberrations = make(lens, half_diagonal=half_diagonal, distortion=settings.distortion)
    except LensError as error:
        raise LensError(f"`lens.name`: {error}") from error
    if settings.engine == "profile":
        aberrations = aberrations.on_axis()
    return aberrations if tilt is None else aberrations + tilt


def picture_shading(settings: LensSettings, focused: FocusedLens, window: Window) -> tuple[float, ...]:
    """Return the relative illumination from the centre of one picture to its corner; empty without a lens.

    Arguments and errors are those of :func:`picture_aberrations`.

    Examples:
        >>> window = Window.whole(32, 24)
        >>> focused = FocusedLens(near=0.5, far=0.5, blur=8, camera=None, plane=None, window=window)
        >>> light = picture_shading(LensSettings(name="petzval"), focused, window)
        >>> light[0], light[-1] < 0.7
        (1.0, True)
    """
    glass = lens_of_picture(settings, focused, window) if settings.vignetting else None
    if glass is None:
        return ()
    lens, half_diagonal = glass
    image_radius = lens.prescription.image_radius if half_diagonal is None else half_diagonal
    light = relative_illumination(lens.centred, image_radius)
    return tuple(float(value) for value in np.maximum(light, _MIN_CORNER_LIGHT))

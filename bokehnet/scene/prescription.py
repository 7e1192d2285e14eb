"""Prescription lens of a scene, scaled and focused like its camera."""

import math

from bokehnet.errors import LensError, ParameterError
from bokehnet.io.window import Window
from bokehnet.lenses.assembly.misalignment import focus_tilt
from bokehnet.lenses.catalog import load_lens
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.scene.focus import FocusedLens
from bokehnet.settings.preset import presets
from bokehnet.settings.settings import LensSettings

__all__ = ["copy_tilt_gradient", "lens_of_picture", "prescription_lens"]


def prescription_lens(
    settings: LensSettings,
    *,
    focal_length: float | None = None,
    f_number: float | None = None,
    distance: float = math.inf,
) -> PrescriptionLens | None:
    """Return the focused lens that the settings name; None without one.

    Args:
        settings: Lens settings.
        focal_length: Focal length, mm; None for that of the design.
        f_number: F-number of the camera, overridden by that of the settings; None for wide open.
        distance: Focus distance, mm.

    Raises:
        LensError: There is no such lens, or it cannot focus or stop down like this.
        ConfigError: Its file is missing or invalid.

    Examples:
        >>> lens = prescription_lens(LensSettings(name="double_gauss"), focal_length=50, f_number=4)
        >>> round(lens.focal_length, 3), lens.f_number  # the design, of 100 mm, at half its size
        (50.0, 4)
    """
    if settings.name is None:
        return None
    try:
        return load_lens(
            settings.name,
            focal_length=focal_length,
            f_number=f_number if settings.f_number is None else settings.f_number,
            focus_distance=distance,
            focusing=settings.focusing or "sharpest",
            copy_to_copy=settings.copy_to_copy or 0.0,
            copy_seed=settings.copy_seed or 0,
        )
    except LensError as error:
        if settings.name in presets():
            raise ParameterError("lens.name", "a lens", shown=f"the preset {settings.name!r}") from error
        hint = "; `lens.f_number` sets that of the lens only" if "f-number" in str(error) else ""
        raise LensError(f"`lens.name`: {error}{hint if settings.f_number is None else ''}") from error


def lens_of_picture(
    settings: LensSettings, focused: FocusedLens, window: Window
) -> tuple[PrescriptionLens, float | None] | None:
    """Return the focused lens and half the diagonal of its sensor, mm; None for that of the design.

    With metric depth the lens is scaled to the camera's focal length, focused like the camera, and has the
    camera's sensor. With relative disparity it has its designed focal length and is focused at infinity.

    Args:
        settings: Lens settings.
        focused: Camera with its focus.
        window: Position of the pixels in the shown picture.

    Raises:
        LensError: The lens cannot focus or stop down like the camera.
        ConfigError: Its file is missing or invalid.

    Examples:
        >>> window = Window.whole(32, 24)
        >>> focused = FocusedLens(near=0.5, far=0.5, blur=8, camera=None, plane=None, window=window)
        >>> lens, half_diagonal = lens_of_picture(LensSettings(name="petzval"), focused, window)
        >>> lens.prescription.name, half_diagonal
        ('Petzval', None)
    """
    camera = focused.camera
    if camera is None:
        lens, half_diagonal = prescription_lens(settings), None
    else:
        distance = 1 / focused.near if focused.near > 0 else math.inf
        half_diagonal = (
            0.5 * camera.sensor_width * math.hypot(1, window.display_height / window.display_width)
        )
        lens = prescription_lens(
            settings, focal_length=camera.focal_length, f_number=camera.f_number, distance=distance
        )
    return None if lens is None else (lens, half_diagonal)


def copy_tilt_gradient(settings: LensSettings, focused: FocusedLens, window: Window) -> tuple[float, float]:
    """Return the tilt of the focus in one copy of a lens, blur per pixel to the right and down; 0 without.

    Arguments and errors are those of :func:`lens_of_picture`.

    Examples:
        >>> window = Window.whole(32, 24)
        >>> focused = FocusedLens(near=0.5, far=0.5, blur=8, camera=None, plane=None, window=window)
        >>> copy_tilt_gradient(LensSettings(name="petzval"), focused, window)
        (0.0, 0.0)
        >>> right, down = copy_tilt_gradient(LensSettings(name="petzval", copy_to_copy=5), focused, window)
        >>> 1e-4 < abs(right) + abs(down) < 1e-2
        True
    """
    glass = lens_of_picture(settings, focused, window)
    return (0.0, 0.0) if glass is None else focus_tilt(glass[0])

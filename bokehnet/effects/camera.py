"""All effects of a camera together, in the order in which light meets them."""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import (
    Array,
    array_namespace,
    check_above,
    check_finite,
    check_kind,
    check_range,
    check_rank,
)
from bokehnet.effects.row_blocks import in_row_blocks
from bokehnet.effects.view import View, cast_like
from bokehnet.effects.warp import Warp
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.optics.aberrations.distortion import Distortion
from bokehnet.optics.grain import Grain
from bokehnet.optics.scalars import is_absent
from bokehnet.optics.vignette import Vignette, cos4_factor, rim_factor, scale_saturation, table_factor

__all__ = ["CameraEffects"]

_ROWS = 256  # at a time

# Share of the colour below which nothing gives it back.
_LEAST_COLOR = 1e-3


@dataclass(frozen=True, kw_only=True, slots=True)
class CameraEffects:
    """Distortion and fringes of the lens, then its vignettes, then the grain of the sensor; default nothing.

    They belong behind the blur, on scene-linear light. Without effects a picture keeps every bit, and each
    effect is continuous in its strength.

    Attributes:
        distortion: Model of where the lens sends light; None keeps straight lines straight.
        lateral: How far apart red and blue are in the corner, half-diagonals, -0.1 to 0.1; above 0 blue lies
            farther out. See :class:`Warp`.
        cos4: Angle between the axis and the picture's corner, degrees, 0 up to 80: darkening by the cos^4
            law.
        optical_vignetting: Shift of the barrel's rim in the corner, in radii of the pupil, 0 to 1.5, as
            ``Aperture.cats_eye``: darkening by what it cuts off.
        shading: Light that a lens leaves over that in the middle, at even steps from the middle of the
            picture to its corner
            (:func:`bokehnet.lenses.aberrations.relative_illumination.relative_illumination`), above 0; beyond
            the corner it stays as it is there. Empty is 1 everywhere.
        vignette: One of taste.
        grain: Noise of the sensor.

    Numbers may be tensors without dimensions.

    Raises:
        ParameterError: A number is out of range.
    """

    distortion: Distortion | None = None
    lateral: Array = 0.0
    cos4: Array = 0.0
    optical_vignetting: Array = 0.0
    shading: tuple[float, ...] = ()
    vignette: Vignette | None = None
    grain: Grain | None = None

    def __post_init__(self) -> None:
        for name, highest in (("cos4", 80.0), ("optical_vignetting", 1.5)):
            check_range(name, getattr(self, name), 0, highest)
        check_kind("shading", self.shading, tuple, list)
        for light in self.shading:
            check_above("shading", light, 0)
        if len(self.shading) == 1:
            raise ParameterError("shading", "two numbers or more, or none", self.shading)
        check_kind("vignette", self.vignette, Vignette, optional=True)
        check_kind("grain", self.grain, Grain, optional=True)
        _ = self._warp

    def apply(self, image: Array, *, view: View | None = None, frame: int = 0) -> Array:
        """Return the picture that the camera takes.

        Args:
            image: Scene-linear, (..., H, W, 3), array or tensor; or with premultiplied alpha, (..., H, W, 4),
                which moves with green and is neither darkened nor grained. In torch differentiable.
            view: Where its pixels lie in the shown picture, which effects are centred about; by default all
                of it is shown.
            frame: Number of the frame; each has a grain of its own.

        Returns:
            The same shape. Grain can take light below 0; nothing is clipped.

        Raises:
            ShapeError: Not (..., H, W, 3) or (..., H, W, 4).
            ParameterError: NaN or infinity, or a distortion that folds over within the picture.
        """
        view = _check(image, view)
        image = self._warp.apply(image, view)
        if self._shades:
            image = self._shade(image, view, undo=False)
        if self.grain is None:
            return image
        return self._take(image, self.grain, view, frame)

    def undo(self, image: Array, *, view: View | None = None) -> Array:
        """Return the picture of which :meth:`apply` made ``image``: but for rounding, and for a resampling.

        What a distortion has cropped is black. Arguments as those of :meth:`apply`.

        Raises:
            ShapeError, ParameterError: As :meth:`apply`; or there is grain, which cannot be undone.
        """
        if self.grain is not None:
            raise ParameterError(
                "grain",
                "None, as grain cannot be undone",
                self.grain,
                "leave it out, by dataclasses.replace(..., grain=None)",
            )
        view = _check(image, view)
        if self._shades:
            image = self._shade(image, view, undo=True)
        return self._warp.undo(image, view)

    @property
    def _warp(self) -> Warp:
        return Warp(distortion=self.distortion, lateral=self.lateral)

    @property
    def _shades(self) -> bool:
        absent = is_absent(self.cos4) and is_absent(self.optical_vignetting)
        return self.vignette is not None or bool(self.shading) or not absent

    def _shade(self, image: Array, view: View, undo: bool) -> Array:
        """Multiply light by all factors, or divide it."""
        xp, width = array_namespace(image), image.shape[-2]

        def shade(rows: slice) -> Array:
            field = view.field(rows, width, image)
            factor = cast_like(self._factor(field, view), image)[..., None]
            light, alpha = image[..., rows, :, :3], image[..., rows, :, 3:]
            light = light / factor if undo else light * factor
            return xp.concatenate([self._color(light, field, view, undo), alpha], -1)

        return in_row_blocks(shade, image, _ROWS)

    def _color(self, light: Array, field: Array, view: View, undo: bool) -> Array:
        """Take colour, or give it back; what is grey altogether stays grey."""
        if self.vignette is None or is_absent(self.vignette.color_loss):
            return light
        share = cast_like(self.vignette.color(field, view.aspect), light)
        if undo:
            xp = array_namespace(share)
            share = xp.where(share > _LEAST_COLOR, 1 / xp.clip(share, _LEAST_COLOR, 1), 0)
        return scale_saturation(light, share)

    def _take(self, image: Array, grain: Grain, view: View, frame: int) -> Array:
        """Add grain to light."""

        def take(rows: slice) -> Array:
            light, alpha = image[..., rows, :, :3], image[..., rows, :, 3:]
            place = {"left": view.left, "top": view.top + rows.start, "frame": frame}
            if not alpha.shape[-1]:
                return grain.add(light, **place)
            return array_namespace(image).concatenate([grain.add(light, alpha, **place), alpha], -1)

        return in_row_blocks(take, image, _ROWS)

    def _factor(self, field: Array, view: View) -> Array:
        """The product of all that is there; each of them costs as much as a blur of a few pixels."""
        xp, factor = array_namespace(field), None
        for amount, made in ((self.cos4, cos4_factor), (self.optical_vignetting, rim_factor)):
            if not is_absent(amount):
                found = made(field, amount)
                factor = found if factor is None else factor * found
        if factor is None:
            factor = xp.ones_like(field[..., 0])
        if self.shading:
            factor = factor * table_factor(field, self.shading)
        return factor if self.vignette is None else factor * self.vignette.factor(field, view.aspect)


def _check(image: Array, view: View | None) -> View:
    """Raise unless ``image`` is a picture; its view."""
    if image.ndim < 3 or image.shape[-1] not in (3, 4):
        raise ShapeError(f"image: expected shape (..., H, W, 3) or (..., H, W, 4), got {tuple(image.shape)}")
    check_rank("image", image.reshape(-1, *image.shape[-2:]), 3, "(..., H, W, C)")
    whole = image.dtype.kind in "iub" if array_namespace(image) is np else not image.is_floating_point()
    if whole:
        raise ParameterError("image", "scene-linear floats", image, shown=str(image.dtype))
    check_finite("image", image)
    return view or View.of(image)

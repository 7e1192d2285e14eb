"""All effects of a camera, in the order of the light path."""

from dataclasses import dataclass

import numpy as np

from bokehnet.arrays.viewport import Viewport
from bokehnet.checks import (
    Array,
    array_namespace,
    check_above,
    check_finite,
    check_kind,
    check_range,
    check_rank,
)
from bokehnet.effects.precision import cast_like
from bokehnet.effects.row_blocks import in_row_blocks
from bokehnet.effects.warp import Warp
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.optics.aberrations.distortion import Distortion
from bokehnet.optics.grain import Grain
from bokehnet.optics.scalars import is_absent
from bokehnet.optics.vignette import Vignette, cos4_factor, rim_factor, scale_saturation, table_factor

__all__ = ["CameraEffects"]

_BLOCK_ROWS = 256  # rows per block

# Minimum fraction of the saturation that can be restored.
_MIN_SATURATION = 1e-3


@dataclass(frozen=True, kw_only=True, slots=True)
class CameraEffects:
    """Distortion and lateral color of the lens, its vignetting, the grain of the sensor; default none.

    They follow the blur, on scene-linear light. Without effects a picture is unchanged bit for bit, and each
    effect is continuous in its strength.

    Attributes:
        distortion: Distortion model of the lens; None keeps straight lines straight.
        lateral: Distance of red and blue in the corner, half-diagonals, -0.1 to 0.1; above 0 blue is
            farther out. See :class:`Warp`.
        cos4: Angle between the axis and the picture's corner, degrees, 0 up to 80: darkening by the cos^4
            law.
        optical_vignetting: Shift of the barrel's rim in the corner, in radii of the pupil, 0 to 1.5, as
            ``Aperture.cats_eye``: darkening by the clipped area.
        shading: Transmitted light relative to the centre, at even steps from the centre of the picture to its
            corner (:func:`bokehnet.lenses.aberrations.relative_illumination.relative_illumination`), above 0;
            constant beyond the corner. Empty is 1 everywhere.
        vignette: Artistic vignette.
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

    def apply(self, image: Array, *, view: Viewport | None = None, frame: int = 0) -> Array:
        """Return the picture with all effects.

        Args:
            image: Scene-linear, (..., H, W, 3), array or tensor; or with premultiplied alpha, (..., H, W, 4),
                which moves with green and is neither darkened nor grained. In torch differentiable.
            view: Position of its pixels in the shown picture, about whose centre effects are centred;
                default: all of it is shown.
            frame: Index of the frame; each has its own grain.

        Returns:
            Same shape. Grain can reduce light below 0; nothing is clipped.

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
        return self._add_grain(image, self.grain, view, frame)

    def undo(self, image: Array, *, view: Viewport | None = None) -> Array:
        """Invert :meth:`apply`, except for rounding and for a resampling.

        Pixels cropped by a distortion are black. Arguments as those of :meth:`apply`.

        Raises:
            ShapeError, ParameterError: See :meth:`apply`; or there is grain, which cannot be undone.
        """
        if self.grain is not None:
            raise ParameterError(
                "grain",
                "None, because grain cannot be undone",
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

    def _shade(self, image: Array, view: Viewport, undo: bool) -> Array:
        """Multiply light by all factors, or divide it."""
        xp, width = array_namespace(image), image.shape[-2]

        def shade(rows: slice) -> Array:
            field = view.field(rows, width, image)
            factor = cast_like(self._factor(field, view), image)[..., None]
            light, alpha = image[..., rows, :, :3], image[..., rows, :, 3:]
            light = light / factor if undo else light * factor
            return xp.concatenate([self._color(light, field, view, undo), alpha], -1)

        return in_row_blocks(shade, image, _BLOCK_ROWS)

    def _color(self, light: Array, field: Array, view: Viewport, undo: bool) -> Array:
        """Reduce the saturation, or restore it; fully grey pixels stay grey."""
        if self.vignette is None or is_absent(self.vignette.color_loss):
            return light
        saturation = cast_like(self.vignette.color(field, view.aspect), light)
        if undo:
            xp = array_namespace(saturation)
            saturation = xp.where(
                saturation > _MIN_SATURATION, 1 / xp.clip(saturation, _MIN_SATURATION, 1), 0
            )
        return scale_saturation(light, saturation)

    def _add_grain(self, image: Array, grain: Grain, view: Viewport, frame: int) -> Array:
        """Add grain to light."""

        def add(rows: slice) -> Array:
            light, alpha = image[..., rows, :, :3], image[..., rows, :, 3:]
            position = {"left": view.left, "top": view.top + rows.start, "frame": frame}
            if not alpha.shape[-1]:
                return grain.add(light, **position)
            return array_namespace(image).concatenate([grain.add(light, alpha, **position), alpha], -1)

        return in_row_blocks(add, image, _BLOCK_ROWS)

    def _factor(self, field: Array, view: Viewport) -> Array:
        """Return the product of all factors; each of them costs as much as a blur of a few pixels."""
        xp, factor = array_namespace(field), None
        for amount, formula in ((self.cos4, cos4_factor), (self.optical_vignetting, rim_factor)):
            if not is_absent(amount):
                value = formula(field, amount)
                factor = value if factor is None else factor * value
        if factor is None:
            factor = xp.ones_like(field[..., 0])
        if self.shading:
            factor = factor * table_factor(field, self.shading)
        return factor if self.vignette is None else factor * self.vignette.factor(field, view.aspect)


def _check(image: Array, view: Viewport | None) -> Viewport:
    """Raise unless ``image`` is a picture; return its view."""
    if image.ndim < 3 or image.shape[-1] not in (3, 4):
        raise ShapeError(f"image: expected shape (..., H, W, 3) or (..., H, W, 4), got {tuple(image.shape)}")
    check_rank("image", image.reshape(-1, *image.shape[-2:]), 3, "(..., H, W, C)")
    is_integer = image.dtype.kind in "iub" if array_namespace(image) is np else not image.is_floating_point()
    if is_integer:
        raise ParameterError("image", "scene-linear floats", image, shown=str(image.dtype))
    check_finite("image", image)
    return view or Viewport.of(image)

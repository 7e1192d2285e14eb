"""Resampling of pictures by the distortion and lateral color of a lens, without a black border."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bokehnet.arrays.viewport import Viewport
from bokehnet.checks import Array, array_namespace, check_kind, check_range
from bokehnet.effects.precision import cast_like
from bokehnet.effects.row_blocks import in_row_blocks
from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.distortion import BrownConrady, Distortion, DivisionModel
from bokehnet.optics.pixels.resampling import inside, sample
from bokehnet.optics.scalars import is_absent, value_of

__all__ = ["Warp"]

_BLOCK_ROWS = 64  # rows per block


@dataclass(frozen=True, kw_only=True, slots=True)
class Warp:
    """Distortion, then a magnification of red and blue about the centre; both in one resampling.

    The position d of the result shows the position ``scale * undistort(d / magnification)`` of the picture.
    The scale is chosen so that every shown pixel is inside the picture, and as much of the picture as
    possible is used: 1 without any effect, below 1 for barrel distortion, whose corners would otherwise be
    outside, so that the picture is enlarged and cropped, including its blur, as if cut from a slightly larger
    sensor. Overscan beyond the shown picture is used first.

    Attributes:
        distortion: Distortion model; None keeps straight lines straight.
        lateral: Blue is magnified by 1 + lateral / 2, red by 1 - lateral / 2: in the corner their distance is
            this fraction of the half-diagonal, above 0 with blue farther out. -0.1 to 0.1. A float, or a
            tensor without dimensions.

    Raises:
        ParameterError: ``lateral`` is out of range.
    """

    distortion: Distortion | None = None
    lateral: Array = 0.0

    def __post_init__(self) -> None:
        check_kind("distortion", self.distortion, DivisionModel, BrownConrady, optional=True)
        check_range("lateral", self.lateral, -0.1, 0.1)

    @property
    def is_off(self) -> bool:
        """True if pictures stay unchanged."""
        return self.distortion is None and is_absent(self.lateral)

    def apply(self, image: Array, view: Viewport | None = None) -> Array:
        """Return the distorted picture.

        Args:
            image: Scene-linear, (..., H, W, C), array or tensor (then differentiable, with respect to
                coefficients that are tensors too). Channels are red, green, blue, then any that move with
                green, such as alpha. Outside it is black.
            view: Position of its pixels in the shown picture; default: all of it is shown.

        Raises:
            ParameterError: The distortion folds over within the picture.
        """
        return self._draw(image, view or Viewport.of(image), undo=False)

    def undo(self, image: Array, view: Viewport | None = None) -> Array:
        """Invert :meth:`apply`; cropped pixels are black.

        Arguments and errors as those of :meth:`apply`.
        """
        return self._draw(image, view or Viewport.of(image), undo=True)

    def check(self) -> None:
        """Raise ``ParameterError`` unless the warp is valid for pictures of all proportions."""
        if self.distortion is not None:
            turn = np.linspace(0, 2 * np.pi, 360)
            self._check(1.0)
            self._undistort(np.stack([np.cos(turn), np.sin(turn)], -1))

    def scale(self, image: Array, view: Viewport) -> Array:
        """Return the scale of the lookup position relative to the shown position; see the class."""
        height, width = image.shape[-3:-1]
        shown = Viewport(width=view.width, height=view.height)
        cover = self._cover(image, shown, shown.height, shown.width)
        if not view.covers_display(height, width):
            return cover
        xp = array_namespace(cover)
        overscan = self._cover(image, view, height, width)
        return xp.minimum(overscan, xp.maximum(cover, 1 + 0 * cover))

    def _cover(self, like: Array, view: Viewport, height: int, width: int) -> Array:
        """Return the largest scale at which no shown pixel reads beyond an array of this size."""
        xp, border = array_namespace(like), view.border(like)
        first = view.places(np.zeros(2))  # from the centre of the array's first pixel to the axis
        reach = np.stack([first, (width - 1, height - 1) - first]) / view.half_diagonal
        smallest = None
        for magnification, _ in self._channels(3):
            d = border / magnification
            self._check(value_of((d * d).sum(-1).max()) ** 0.5)
            u = self._undistort(d)
            for axis in (0, 1):
                for sign, distance in ((-1, reach[0, axis]), (1, reach[1, axis])):
                    outwards = sign * u[:, axis] > 1e-9
                    if not bool(outwards.any()):
                        continue
                    scale = (float(distance) / (sign * u[:, axis])[outwards]).min()
                    smallest = scale if smallest is None else xp.minimum(smallest, scale)
        return np.float64(1.0) if smallest is None else smallest

    def _check(self, radius: float) -> None:
        """Raise unless positions up to ``radius`` half-diagonals have one position in the picture each."""
        if self.distortion is not None and not radius < self.distortion.reach:
            raise ParameterError(
                "distortion",
                f"a picture that folds over itself at least {radius:.3g} half-diagonals from the middle",
                self.distortion,
                "take smaller coefficients",
                shown=f"one at {self.distortion.reach:.3g}",
            )

    def _channels(self, count: int) -> Iterator[tuple[Array, slice]]:
        """Yield magnifications and their channels."""
        if is_absent(self.lateral):
            yield 1.0, slice(0, count)
            return
        yield 1 - self.lateral / 2, slice(0, 1)
        yield 1.0, slice(1, 2)
        yield 1 + self.lateral / 2, slice(2, 3)
        if count > 3:
            yield 1.0, slice(3, count)

    def _draw(self, image: Array, view: Viewport, undo: bool) -> Array:
        if self.is_off:
            return image
        height, width, channels = image.shape[-3:]
        xp, scale = array_namespace(image), self.scale(image, view)
        planes = [(magnification, image[..., channel]) for magnification, channel in self._channels(channels)]
        if xp is np:  # contiguous planes, once and not for each block
            planes = [(magnification, np.ascontiguousarray(plane)) for magnification, plane in planes]

        def draw(rows: slice) -> Array:
            field, channel_images = view.field(rows, width, image), []
            for magnification, plane in planes:
                positions = view.places(self._source(field, magnification, scale, undo))
                channel_images.append(
                    sample(plane, positions) * cast_like(inside(positions, height, width), image)[..., None]
                )
            return xp.concatenate(channel_images, -1)

        return in_row_blocks(draw, image, _BLOCK_ROWS)

    def _source(self, field: Array, magnification: Array, scale: Array, undo: bool) -> Array:
        """Return the position from which the light at ``field`` comes."""
        if undo:
            u = field / scale
            d = u if self.distortion is None else self.distortion.distort(u)
            return d * magnification
        d = field / magnification
        return scale * self._undistort(d)

    def _undistort(self, d: Array) -> Array:
        try:
            return d if self.distortion is None else self.distortion.undistort(d)
        except ParameterError as error:  # names a coefficient of the model
            raise error.renamed("distortion") from error

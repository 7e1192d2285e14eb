"""Samples of the pupil: of a fixed aperture, or of one whose shape has gradients."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from bokehnet.classical.rays_renderer import pupil_pattern
from bokehnet.classical.torch.not_compiled import not_compiled
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture

__all__ = ["PupilSamples", "SmoothAperture", "pupil_samples", "vignetting_weight"]

# A second pupil disc of a fixed aperture clips at once.
_HARD_EDGE = 1e-6

# Floor under the square of a distance whose root is differentiated.
_EPSILON = 1e-12


@dataclass(frozen=True, kw_only=True)
class SmoothAperture:
    """Aperture whose numbers have gradients: weights fall smoothly across its edges.

    Numbers are floats or tensors of shape (). Shapes and signs are those of
    :class:`bokehnet.optics.aperture.Aperture`.

    Attributes:
        blades: Number of blades, 3 to 16; 0 is a round aperture.
        curvature: Curvature of the blades, 0 (straight) to 1 (disc).
        rotation: Rotation of the blades, degrees, counter-clockwise as seen.
        squeeze: Width over height of the blur disc; the longer axis keeps its size.
        cats_eye: Shift of the second pupil disc in the corner of the picture, pupil radii.
        softness: Width of the edges of blades and cat's-eye, pupil radii.
    """

    blades: int = 0
    curvature: float | Tensor = 0.0
    rotation: float | Tensor = 0.0
    squeeze: float | Tensor = 1.0
    cats_eye: float | Tensor = 0.0
    softness: float = 0.05

    def __post_init__(self) -> None:
        if self.blades != 0 and not 3 <= self.blades <= 16:
            raise ParameterError("blades", "0 (disc) or 3 to 16", self.blades)
        if not self.softness > 0:
            raise ParameterError("softness", "a number above 0", self.softness)


class PupilSamples(NamedTuple):
    """Samples of the pupil in sets; a pixel uses one set.

    Attributes:
        points: Aperture coordinates (u, v), (2, sets, samples).
        weights: Weights in front of and behind focus, (2, sets, samples).
        cats_eye: Shift of the second pupil disc in the corner, pupil radii, shape (); None without.
        softness: Width of the edge of the second disc, pupil radii.
    """

    points: Tensor
    weights: Tensor
    cats_eye: Tensor | None
    softness: float


def _blade_weight(aperture: SmoothAperture, u: Tensor, v: Tensor) -> Tensor:
    """Return the weight at (u, v): a sigmoid of the distance from the blades.

    The formula is that of :func:`bokehnet.optics.aperture.blade_margin`.
    """
    curvature = torch.as_tensor(aperture.curvature).to(u)
    angle = torch.deg2rad(torch.as_tensor(aperture.rotation).to(u))
    u, v = u * angle.cos() - v * angle.sin(), u * angle.sin() + v * angle.cos()
    half_angle = math.pi / aperture.blades
    sine, cosine = math.sin(half_angle), math.cos(half_angle)
    w = (1 - (curvature * sine) ** 2).sqrt()
    k, m = w - curvature * cosine, 2 * w * cosine - curvature * math.cos(2 * half_angle)
    angles = [2 * edge * half_angle for edge in range(aperture.blades)]
    along = torch.stack([v * math.sin(a) - u * math.cos(a) for a in angles]).amax(0)
    rho2 = u * u + v * v
    gradient = 2 * (curvature**2 * rho2 + 2 * curvature * k * along + k * k).clamp(min=_EPSILON).sqrt()
    return torch.sigmoid(4 / aperture.softness * (m - (curvature * rho2 + 2 * k * along)) / gradient)


@not_compiled  # made with NumPy
def _fixed_samples(aperture: Aperture) -> tuple[Tensor, Tensor]:
    """Return points and weights of a fixed aperture, (2, sets, samples) each, float32."""
    points, weights, _ = pupil_pattern(aperture)
    return torch.from_numpy(points), torch.from_numpy(weights)


def pupil_samples(aperture: Aperture | SmoothAperture | None, samples: int, like: Tensor) -> PupilSamples:
    """Return samples of an aperture in the dtype and on the device of ``like``.

    Fixed apertures use the points of the numba rays, :func:`bokehnet.classical.rays_renderer.pupil_pattern`.

    Raises:
        ParameterError: ``samples`` is not 1 to 128.
    """
    smooth = aperture if isinstance(aperture, SmoothAperture) else None
    fixed = aperture if isinstance(aperture, Aperture) else Aperture()
    points, weights = _fixed_samples(fixed)
    if not 1 <= samples <= points.shape[2]:
        raise ParameterError("samples", f"1 to {points.shape[2]}", samples)
    point_tensor, weight_tensor = points[..., :samples].to(like), weights[..., :samples].to(like)
    if smooth is None:
        cats_eye = like.new_tensor(fixed.cats_eye) if fixed.cats_eye > 0 else None
        return PupilSamples(point_tensor, weight_tensor, cats_eye, _HARD_EDGE)
    u, v = point_tensor
    if smooth.blades:
        weight_tensor = weight_tensor * _blade_weight(smooth, u, v)
    squeeze = torch.as_tensor(smooth.squeeze).to(like)
    point_tensor = torch.stack([u / (1 / squeeze).clamp(min=1), v / squeeze.clamp(min=1)])
    has_cats_eye = isinstance(smooth.cats_eye, Tensor) or smooth.cats_eye > 0
    cats_eye = torch.as_tensor(smooth.cats_eye).to(like) if has_cats_eye else None
    return PupilSamples(point_tensor, weight_tensor, cats_eye, smooth.softness)


def vignetting_weight(
    pupil: PupilSamples, u: Tensor, v: Tensor, position: tuple[Tensor, Tensor], size: tuple[int, int]
) -> Tensor:
    """Return the weight of rays under the second pupil disc.

    The shift is that of :func:`bokehnet.optics.aperture.cats_eye_shift`.

    Args:
        pupil: Samples with a cat's-eye.
        u: Aperture coordinate to the right.
        v: Aperture coordinate down.
        position: Column and row of the pixels.
        size: Height and width of the picture, pixels.
    """
    assert pupil.cats_eye is not None
    height, width = size
    scale = 2 * pupil.cats_eye / math.hypot(width, height)
    away_u = u - scale * (position[0] - 0.5 * (width - 1))
    away_v = v - scale * (position[1] - 0.5 * (height - 1))
    distance = (away_u * away_u + away_v * away_v + _EPSILON).sqrt()
    return torch.sigmoid((4 / pupil.softness * (1 - distance)).clamp(-60, 60))

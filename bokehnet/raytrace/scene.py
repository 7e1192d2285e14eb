"""Scene of textured planes with alpha and one infinite background."""

import itertools
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bokehnet.checks import check_at_least
from bokehnet.errors import ParameterError, ShapeError

__all__ = ["Background", "Plane", "Scene", "Vector", "background_from", "plane_texture"]

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Plane:
    """Textured parallelogram: the points ``centre + a * u_axis + b * v_axis`` with a, b in [-1, 1].

    Attributes:
        texture: Scene-linear RGB times alpha, and alpha, (4, Ht, Wt); columns run along ``u_axis``, rows
            along ``v_axis``. The texture fades over its outermost texel and is transparent outside.
        centre: Position, mm; x to the right and y down in the picture, z along the optical axis.
        u_axis: Half extent along the columns of the texture, mm.
        v_axis: Half extent along its rows, mm.

    Raises:
        ShapeError: ``texture`` is not (4, Ht, Wt).
        ParameterError: A corner is not in front of the lens, or the axes are parallel.
    """

    texture: Tensor
    centre: Vector
    u_axis: Vector
    v_axis: Vector

    def __post_init__(self) -> None:
        if self.texture.ndim != 3 or self.texture.shape[0] != 4 or 0 in self.texture.shape:
            raise ShapeError(f"plane texture: expected shape (4, Ht, Wt), got {tuple(self.texture.shape)}")
        if not self.corners[:, 2].min() > 0:
            nearest = self.corners[:, 2].min()
            expected = "with `u_axis` and `v_axis`, all corners at z > 0"
            raise ParameterError(
                "centre", expected, self.centre, "move it away", shown=f"the nearest at {nearest:g} mm"
            )
        if not np.linalg.norm(np.cross(self.u_axis, self.v_axis)) > 0:
            expected = "two different axes, with `v_axis`"
            raise ParameterError("u_axis", expected, self.u_axis, shown=f"{self.u_axis} and {self.v_axis}")

    @property
    def corners(self) -> np.ndarray:
        """Corners, mm, (4, 3)."""
        centre, u, v = (np.array(vector, float) for vector in (self.centre, self.u_axis, self.v_axis))
        return np.stack([centre + a * u + b * v for a, b in itertools.product((-1, 1), repeat=2)])


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Background:
    """Opaque infinite plane that faces the lens; its texture is mirrored outside.

    Attributes:
        texture: Scene-linear RGB, (3, Ht, Wt).
        half_extent: Half width and half height of the texture as slopes: lateral extent over depth.
        disparity: Inverse depth, 1/mm; 0 is infinitely far, like a sky.

    Raises:
        ShapeError: ``texture`` is not (3, Ht, Wt).
        ParameterError: The extent is not positive or the disparity is negative.
    """

    texture: Tensor
    half_extent: tuple[float, float]
    disparity: float = 0.0

    def __post_init__(self) -> None:
        if self.texture.ndim != 3 or self.texture.shape[0] != 3 or 0 in self.texture.shape:
            shape = tuple(self.texture.shape)
            raise ShapeError(f"background texture: expected shape (3, Ht, Wt), got {shape}")
        if not min(self.half_extent) > 0:
            raise ParameterError("half_extent", "more than 0", self.half_extent)
        check_at_least("disparity", self.disparity, 0)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scene:
    """Planes in any order in front of a background; device and dtype are those of the textures.

    Attributes:
        background: Background for rays that pass all planes.
        planes: Planes, which may overlap and intersect; they are sorted per ray.
    """

    background: Background
    planes: tuple[Plane, ...] = ()


def plane_texture(rgb: np.ndarray, alpha: np.ndarray | None = None) -> Tensor:
    """Return colour (H, W, 3), scene-linear, and alpha (H, W) as a premultiplied float32 tensor (4, H, W)."""
    coverage = np.ones(rgb.shape[:2], np.float32) if alpha is None else alpha
    if coverage.shape != rgb.shape[:2]:
        raise ShapeError(f"alpha has shape {coverage.shape} but colour has {rgb.shape}; they must agree")
    joined = np.concatenate([rgb * coverage[..., None], coverage[..., None]], -1, dtype=np.float32)
    return torch.from_numpy(np.ascontiguousarray(joined.transpose(2, 0, 1)))


def background_from(rgb: np.ndarray, half_extent: tuple[float, float], disparity: float = 0.0) -> Background:
    """Return a :class:`Background` from colour (H, W, 3), scene-linear."""
    texture = torch.from_numpy(np.ascontiguousarray(rgb.transpose(2, 0, 1), np.float32))
    return Background(texture=texture, half_extent=half_extent, disparity=disparity)

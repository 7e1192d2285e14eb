"""Camera: a lens in front of a grid of pixels."""

from dataclasses import dataclass

import torch
from torch import Tensor

from bokehnet.checks import check_at_least
from bokehnet.errors import ParameterError
from bokehnet.lenses import LensModel
from bokehnet.raytrace.scene import Vector

__all__ = ["Camera", "Pose"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Pose:
    """Position and orientation of a camera in the world.

    Attributes:
        rotation: Rows of the matrix from the camera's axes to those of the world.
        position: Position of the lens, mm.
    """

    rotation: tuple[Vector, Vector, Vector]
    position: Vector


@dataclass(frozen=True, kw_only=True, slots=True)
class Camera:
    """Lens with a sensor behind it; the picture is upright, x to the right and y down.

    Attributes:
        lens: Any lens model.
        width: Picture width, pixels.
        height: Picture height, pixels.
        pixel_pitch: Distance between the centres of two pixels, mm.
        pose: Pose of the camera; None is at the origin, along z.

    Raises:
        ParameterError: The picture is empty or the pitch is not positive.
    """

    lens: LensModel
    width: int
    height: int
    pixel_pitch: float
    pose: Pose | None = None

    def __post_init__(self) -> None:
        check_at_least("width", self.width, 1)
        check_at_least("height", self.height, 1)
        check_at_least("pixel_pitch", self.pixel_pitch, 0)
        if self.pixel_pitch == 0:
            raise ParameterError("pixel_pitch", "more than 0 mm", self.pixel_pitch)

    def sensor_xy(self, device: torch.device, dtype: torch.dtype) -> Tensor:
        """Return the sensor positions of the pixel centres, mm, (height, width, 2).

        The lens inverts the image: a pixel to the right of and below the picture's centre lies to the left of
            and above the axis on the sensor.
        """
        x = torch.arange(self.width, device=device, dtype=dtype) + (0.5 - self.width / 2)
        y = torch.arange(self.height, device=device, dtype=dtype) + (0.5 - self.height / 2)
        planar = torch.stack([x.expand(self.height, -1), y[:, None].expand(-1, self.width)])
        return (-self.pixel_pitch * planar).permute(1, 2, 0)

"""Gain maps of photographs: the light above white that the phone measured."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bokehnet.arrays.resample import resample
from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.io.formats.heif import is_heif, read_heif_gain_map
from bokehnet.io.metadata.gain_map import AppleCoding, GainCoding, jpeg_gain_map
from bokehnet.io.phone_depth import embedded_picture
from bokehnet.io.pixels import ImageFile

__all__ = ["GainMap", "read_gain_map"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class GainMap:
    """Gain map of a picture.

    Attributes:
        kind: Name of its specification.
        stored: Values of 0 to 1, upright, at their own size, (h, w, 1 or 3).
        coding: Conversion of the values to gains.
    """

    kind: str
    stored: NDArray[np.float32]
    coding: GainCoding | AppleCoding

    @property
    def largest(self) -> float:
        """Largest gain that the map can express."""
        if isinstance(self.coding, AppleCoding):
            return self.coding.headroom
        return float(2.0 ** max(self.coding.high))

    def light(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the light of the picture (H, W, 3), scene-linear, as on a display without limits.

        Sources:
            ISO 21496-1, 2025, 5.2, and Adobe, "Gain map specification", 2023, with weight 1. Apple,
            "Applying Apple HDR effect to your photos", 2023; the map has the curve of sRGB.
        """
        height, width = image.shape[:2]
        stored, coding = resample(self.stored, height, width, "linear"), self.coding
        if isinstance(coding, AppleCoding):
            return np.asarray(image * (1 + np.float32(coding.headroom - 1) * srgb_to_linear(stored)))
        parts = coding.low, coding.high, coding.gamma, coding.base_offset, coding.offset
        low, high, gamma, base, offset = (np.asarray(part, np.float32) for part in parts)
        log_gain = low + (high - low) * stored ** (1 / gamma)
        return np.asarray((image + base) * np.exp2(log_gain) - offset, np.float32)


def read_gain_map(path: Path, orientation: int, exif: bytes | None) -> GainMap | None:
    """Read the gain map inside a JPEG or HEIC file; None if there is none.

    Args:
        path: JPEG or HEIC file.
        orientation: EXIF orientation of the primary picture of a JPEG, which is that of its map.
        exif: EXIF of the primary picture, or None.

    Raises:
        ImageFileError: The map is damaged.
    """
    if is_heif(path):
        item = read_heif_gain_map(path, exif)
        return None if item is None else GainMap(kind=item[0], stored=item[1], coding=item[2])
    encoded = jpeg_gain_map(path, exif)
    if encoded is None:
        return None
    with embedded_picture(path, encoded.picture, "gain map") as name, ImageFile(name) as file:
        part = file.parts[0]
        names = [channel for channel in part.channels if channel != part.alpha]
        stored = file.read(replace(part, orientation=orientation), names)
    return GainMap(kind=encoded.kind, stored=np.clip(stored, 0, 1), coding=encoded.coding)

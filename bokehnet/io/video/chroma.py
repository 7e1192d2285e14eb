"""Conversion between luma and chroma planes and encoded red, green and blue.

Source: ITU-T H.273, "Coding-independent code points for video signal type identification", 2021, 8.3.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.errors import ImageFileError

__all__ = ["PixelFormat"]

Array = npt.NDArray[np.float32]

# Matrix coefficients to the weights of red and blue in luma, H.273, table 4.
_LUMA_WEIGHTS = {1: (0.2126, 0.0722), 5: (0.299, 0.114), 6: (0.299, 0.114), 9: (0.2627, 0.0593)}

# Pictures without a matrix are treated as Rec. 709 from this height on; smaller ones as Rec. 601.
_MIN_REC709_HEIGHT_PX = 720


@dataclass(frozen=True, kw_only=True, slots=True)
class PixelFormat:
    """Representation of colours in luma and chroma planes.

    Attributes:
        bits: Bits per value.
        halved: True for each axis, columns and rows, in which chroma has half the resolution.
        matrix: Matrix coefficients of H.273; 2 if unspecified.
        full: True if values use their full range; otherwise luma is 16 to 235, in 8 bits.

    Formats without chroma are grey.

    Examples:
        >>> grey = np.full((4, 4, 3), 0.5, np.float32)
        >>> planes = PixelFormat(bits=10, halved=(True, True), matrix=1, full=False).planes(grey)
        >>> [(plane.shape, int(plane[0, 0])) for plane in planes]  # 64 + 0.5 * 876
        [((4, 4), 502), ((2, 2), 512), ((2, 2), 512)]
    """

    bits: int
    halved: tuple[bool, bool]
    matrix: int
    full: bool

    @classmethod
    def named(cls, name: str, matrix: int, full: bool) -> "PixelFormat":
        """Return the format with this FFmpeg name, such as yuv420p10le or gray16le.

        Raises:
            ImageFileError: The format is not grey and does not have planes of luma and chroma.
        """
        kind = name.removesuffix("le").replace("yuvj", "yuv")
        if kind.startswith("gray") and (kind[4:] or "8").isdigit():
            return cls(bits=int(kind[4:] or 8), halved=(False, False), matrix=matrix, full=full)
        chroma, _, bits = kind.removeprefix("yuv").partition("p")
        halves = {"420": (True, True), "422": (True, False), "444": (False, False)}
        if not kind.startswith("yuv") or chroma not in halves or not (bits or "8").isdigit():
            alpha = name.startswith(("yuva", "ya")) or name in ("rgba", "bgra", "argb", "abgr", "gbrap")
            reason = ", which have alpha" if alpha else ""
            raise ImageFileError(
                f"expected a video with planes of luma and chroma, found pixels of {name}{reason}; "
                "convert it, or render its frames as numbered files"
            )
        full = full or name.startswith("yuvj")
        return cls(bits=int(bits or 8), halved=halves[chroma], matrix=matrix, full=full)

    def colors(self, planes: list[npt.NDArray[np.unsignedinteger]]) -> Array:
        """Return encoded red, green and blue, (H, W, 3), from luma (H, W) and chroma."""
        luma, *chroma = (np.asarray(plane, np.float32) for plane in planes)
        (low, white), (middle, span) = self._scales()
        height, width = luma.shape
        y = (luma - low) / white
        if not chroma:
            return np.repeat(y[..., None], 3, 2)
        blue, red = ((self._upsample(plane, height, width) - middle) / span for plane in chroma)
        kr, kb = self._luma_weights(height)
        r, b = y + 2 * (1 - kr) * red, y + 2 * (1 - kb) * blue
        return np.stack([r, (y - kr * r - kb * b) / (1 - kr - kb), b], 2).astype(np.float32)

    def planes(self, colors: Array) -> list[npt.NDArray[np.uint16]]:
        """Return rounded luma (H, W) and chroma of encoded red, green and blue (H, W, 3)."""
        (low, white), (middle, span) = self._scales()
        kr, kb = self._luma_weights(len(colors))
        r, g, b = np.moveaxis(np.asarray(colors, np.float32), 2, 0)
        y = kr * r + (1 - kr - kb) * g + kb * b
        planes = [low + white * y]
        for value, weight in ((b, kb), (r, kr)):
            planes.append(middle + span * self._downsample((value - y) / (2 * (1 - weight))))
        return [np.clip(np.rint(plane), 0, 2**self.bits - 1).astype(np.uint16) for plane in planes]

    def _scales(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return black and the span to white of luma; the middle and the span of chroma."""
        unit, max_value = 2.0 ** (self.bits - 8), 2.0**self.bits - 1
        if self.full:
            return (0.0, max_value), (128 * unit, max_value)
        return (16 * unit, 219 * unit), (128 * unit, 224 * unit)

    def _luma_weights(self, height: int) -> tuple[float, float]:
        return _LUMA_WEIGHTS.get(self.matrix, _LUMA_WEIGHTS[1 if height >= _MIN_REC709_HEIGHT_PX else 6])

    def _upsample(self, plane: Array, height: int, width: int) -> Array:
        """Return chroma at the size of luma: its columns coincide with luma's, its rows lie between two."""
        if self.halved[1]:
            above = np.concatenate([plane[:1], plane[:-1]])
            below = np.concatenate([plane[1:], plane[-1:]])
            rows = np.stack([0.75 * plane + 0.25 * above, 0.75 * plane + 0.25 * below], 1)
            plane = np.asarray(rows.reshape(-1, plane.shape[1])[:height], np.float32)
        if self.halved[0]:
            after = np.concatenate([plane[:, 1:], plane[:, -1:]], 1)
            plane = np.stack([plane, 0.5 * (plane + after)], 2).reshape(len(plane), -1)[:, :width]
        return plane

    def _downsample(self, plane: Array) -> Array:
        if self.halved[0]:
            padded = np.pad(plane, [(0, 0), (1, 1)], "edge")
            plane = (0.25 * padded[:, :-2] + 0.5 * padded[:, 1:-1] + 0.25 * padded[:, 2:])[:, ::2]
        if self.halved[1]:
            padded = np.pad(plane, [(0, len(plane) % 2), (0, 0)], "edge")
            plane = 0.5 * (padded[::2] + padded[1::2])
        return plane

"""Depth of a single picture, guessed by any monocular network in ONNX; without torch."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from bokehnet.checks import check_image
from bokehnet.errors import ModelFileError
from bokehnet.inference.depth_convention import DepthConvention
from bokehnet.io.resample import resample
from bokehnet.onnx_session import OnnxSession

__all__ = ["DepthEstimator"]

_TYPES: dict[str, type[np.floating]] = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
_SMALLEST_SIDE, _LARGEST_INPUT = 8, 2**26  # pixels; less or more is a misread, broken or hostile network
_MM = {"m": 1000.0, "mm": 1.0}


class DepthEstimator:
    """Estimates disparity on the CPU.

    The network is the caller's and is run as it is: a file from a stranger can use up time and memory, but
    ONNX Runtime runs no code from it and, from version 1.24.1 on, reads no other file but weights beside it.

    Args:
        model: ONNX file with one picture as its input and a map as its first output. Weights in further
            files must lie in its folder.
        convention: What it wants to see and what it gives back.
        threads: Threads inside the network; 0 takes all cores.

    Raises:
        ModelFileError: The file is missing or no ONNX, or the network takes something else than a picture.
    """

    def __init__(self, model: Path | str, convention: DepthConvention, threads: int = 0) -> None:
        self._path, self._convention = Path(model), convention
        if not self._path.is_file():
            found = "a folder" if self._path.is_dir() else "no such file"
            raise ModelFileError(f"{model}: expected an ONNX file, found {found}")
        options = {"intra_op_num_threads": threads, "log_severity_level": 4}  # errors come as exceptions
        try:
            self._session = OnnxSession(str(self._path), options=options)
        except Exception as error:  # the runtime's own have no common base
            raise ModelFileError(f"{model}: not a usable ONNX file: {_one_line(error)}") from error
        self._name, self._dtype, self._fixed = self._check_input()

    @property
    def metric(self) -> bool:
        """Whether :meth:`__call__` returns 1/mm."""
        return self._convention.unit != "none"

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """Return the disparity of a picture; near is large.

        The network's map is brought to the picture's size by cubic interpolation: its soft edges stay soft
        there, which is what ``DisparityRepair`` sharpens.

        Args:
            image: Scene-linear, (H, W, 3).

        Returns:
            (H, W) float32: 1/mm if :attr:`metric`, else between 0 and 1, which occur unless all is equally
            far. A network that gives depth up to scale and shift is turned over, 1 - depth.

        Raises:
            ModelFileError: The network fails, or returns something else than a map of finite numbers,
                above 0 where they are depth in a unit.
            ShapeError, ParameterError: The picture is not as described.
        """
        check_image("image", image)
        height, width = image.shape[:2]
        fed = self._convention.prepare(image, *self._convention.input_size(height, width, self._fixed))
        try:
            result = self._session.run({self._name: fed.astype(self._dtype)})[0]
        except Exception as error:
            raise ModelFileError(f"{self._path}: the network failed: {_one_line(error)}") from error
        return resample(self._disparity(self._map(result)), height, width)

    def _check_input(self) -> tuple[str, type[np.floating], tuple[int | None, int | None]]:
        """Name and type of the input, the height and width that it fixes; raise unless it is a picture."""
        inputs, layout = self._session.inputs(), self._convention.layout
        if len(inputs) != 1:
            names = ", ".join(item.name for item in inputs) or "none"
            raise ModelFileError(f"{self._path}: expected one input, a picture, found {len(inputs)}: {names}")
        shape = inputs[0].shape
        told = f"{inputs[0].name} of shape {tuple(shape)} and {inputs[0].type}"
        if inputs[0].type not in _TYPES or len(shape) != 4:
            raise ModelFileError(
                f"{self._path}: expected a picture {layout} of floats as input, found {told}"
            )
        sizes = dict(zip(layout, (size if isinstance(size, int) else None for size in shape), strict=True))
        if sizes["C"] not in (3, None) or sizes["N"] not in (1, None):
            raise ModelFileError(f"{self._path}: expected one picture {layout} of 3 channels, found {told}")
        fixed = [size for size in (sizes["H"], sizes["W"]) if size is not None]
        if min(fixed, default=_SMALLEST_SIDE) < _SMALLEST_SIDE or math.prod(fixed) > _LARGEST_INPUT:
            raise ModelFileError(
                f"{self._path}: expected a picture {layout} of a sensible size, found {told}"
            )
        return inputs[0].name, _TYPES[inputs[0].type], (sizes["H"], sizes["W"])

    def _map(self, result: Any) -> np.ndarray:
        """Return the map in an output, (h, w), double precision."""
        shape = np.shape(result)
        sides = [size for size in shape if size != 1]
        if not isinstance(result, np.ndarray) or result.dtype.kind not in "fiu" or len(sides) != 2:
            raise ModelFileError(
                f"{self._path}: expected one map of numbers as its first output, found shape {shape}"
            )
        values = result.reshape(sides).astype(np.float64)
        if bad := int((~np.isfinite(values)).sum()):
            raise ModelFileError(
                f"{self._path}: {bad} of {values.size} values of its output are NaN or infinite; "
                f"is it the right convention?"
            )
        return values

    def _disparity(self, values: np.ndarray) -> np.ndarray:
        convention = self._convention
        if convention.unit == "none":
            low, high = float(values.min()), float(values.max())
            relative = (values - low) / (high - low) if high > low else np.zeros_like(values)
            return np.asarray(1 - relative if convention.output == "depth" else relative, np.float32)
        if convention.output == "depth" and not (values > 0).all():
            raise ModelFileError(
                f"{self._path}: expected depth above 0, found {values.min():g}; is it the right convention?"
            )
        unit = _MM[convention.unit]
        disparity = values / unit if convention.output == "disparity" else 1 / (values * unit)
        return np.asarray(disparity, np.float32)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())

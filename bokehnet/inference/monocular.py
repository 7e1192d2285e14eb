"""Depth of a single picture, guessed by any monocular network in ONNX; without torch."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from bokehnet.arrays.resample import resample
from bokehnet.checks import check_image
from bokehnet.errors import ModelFileError
from bokehnet.inference.depth_convention import DepthConvention
from bokehnet.inference.point_maps import shift_of_points
from bokehnet.onnx_session import OnnxSession

__all__ = ["DepthEstimator"]

_TYPES: dict[str, type[np.floating]] = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
_SMALLEST_SIDE, _LARGEST_INPUT = 8, 2**26  # pixels; less or more is a misread, broken or hostile network
_MM = {"m": 1000.0, "mm": 1.0}
_TOKENS = "num_tokens"  # input of networks whose resolution is told beside the picture


class DepthEstimator:
    """Estimates disparity on the CPU.

    The network is the caller's and is run as it is: a file from a stranger can use up time and memory, but
    ONNX Runtime runs no code from it and, from version 1.24.1 on, reads no other file but weights beside it.

    Args:
        model: ONNX file with one picture as its input, and its map where the convention says. Weights in
            further files must lie in its folder.
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
        self._outputs = self._check_outputs()

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
        arrays: dict[str, np.ndarray] = {self._name: fed.astype(self._dtype)}
        if self._convention.tokens is not None:
            arrays[_TOKENS] = np.array(self._convention.tokens, np.int64)
        try:
            results = dict(zip(self._outputs, self._session.run(arrays), strict=True))
        except Exception as error:
            raise ModelFileError(f"{self._path}: the network failed: {_one_line(error)}") from error
        return resample(self._disparity(*self._map(results)), height, width)

    def _check_input(self) -> tuple[str, type[np.floating], tuple[int | None, int | None]]:
        """Name and type of the input, the height and width that it fixes; raise unless it is a picture."""
        inputs, layout = self._session.inputs(), self._convention.layout
        if self._convention.tokens is not None:
            inputs = [item for item in inputs if item.name != _TOKENS]
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

    def _check_outputs(self) -> list[str]:
        """Names of the outputs; raise unless those that the convention names are there."""
        names = [item.name for item in self._session.outputs()]
        for wanted in (self._convention.map, self._convention.scale, self._convention.mask):
            if wanted and wanted not in names:
                raise ModelFileError(
                    f"{self._path}: expected an output {wanted}, found {', '.join(names)}; "
                    "is it the right convention?"
                )
        return names

    def _map(self, results: dict[str, Any]) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the map in the outputs, (h, w), double precision, and where there is a surface."""
        convention = self._convention
        name = convention.map or self._outputs[0]
        surface = self._numbers(results[convention.mask], convention.mask) > 0.5 if convention.mask else None
        if convention.component is None:
            values = self._numbers(results[name], name)
        else:
            points = self._points(results[name], name)
            values = points[convention.component]
            if convention.shift == "unknown":
                values = values + shift_of_points(points, surface)
        if convention.scale:
            scale = np.asarray(results[convention.scale], np.float64)
            if scale.size != 1 or not np.isfinite(scale).all() or not (scale > 0).all():
                raise ModelFileError(f"{self._path}: expected one number above 0 as {convention.scale}")
            values = values * scale.item()
        return values, surface

    def _numbers(self, result: Any, name: str) -> np.ndarray:
        shape = np.shape(result)
        sides = [size for size in shape if size != 1]
        if not isinstance(result, np.ndarray) or result.dtype.kind not in "fiu" or len(sides) != 2:
            order = "its first output" if name == self._outputs[0] else f"its output {name}"
            raise ModelFileError(f"{self._path}: expected one map of numbers as {order}, found shape {shape}")
        return self._finite(result.reshape(sides).astype(np.float64))

    def _points(self, result: Any, name: str) -> np.ndarray:
        """Return a map of points, (3, h, w); it may come with its coordinates first or last."""
        shape = np.shape(result)
        if isinstance(result, np.ndarray) and result.dtype.kind == "f" and len(shape) == 4 and shape[0] == 1:
            if shape[1] == 3:
                return self._finite(result[0].astype(np.float64))
            if shape[3] == 3:
                return self._finite(result[0].transpose(2, 0, 1).astype(np.float64))
        raise ModelFileError(f"{self._path}: expected a map of points as {name}, found shape {shape}")

    def _finite(self, values: np.ndarray) -> np.ndarray:
        if bad := int((~np.isfinite(values)).sum()):
            raise ModelFileError(
                f"{self._path}: {bad} of {values.size} values of its output are NaN or infinite; "
                f"is it the right convention?"
            )
        return values

    def _disparity(self, values: np.ndarray, surface: np.ndarray | None) -> np.ndarray:
        convention = self._convention
        if convention.unit == "none":
            low, high = float(values.min()), float(values.max())
            relative = (values - low) / (high - low) if high > low else np.zeros_like(values)
            return np.asarray(1 - relative if convention.output == "depth" else relative, np.float32)
        if surface is not None:
            values = np.where(surface, values, np.inf)
        if convention.output == "depth" and not (values > 0).all():
            raise ModelFileError(
                f"{self._path}: expected depth above 0, found {values.min():g}; is it the right convention?"
            )
        unit = _MM[convention.unit]
        disparity = values / unit if convention.output == "disparity" else 1 / (values * unit)
        return np.asarray(disparity, np.float32)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())

"""Depth of a single picture, estimated by any monocular network in ONNX; does not need torch."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from bokehnet.arrays.resample import resample
from bokehnet.checks import check_image
from bokehnet.errors import ModelFileError, errors_of_file
from bokehnet.inference.depth_convention import DepthConvention
from bokehnet.inference.point_maps import shift_of_points
from bokehnet.onnx_session import OnnxSession

__all__ = ["DepthEstimator"]

_TYPES: dict[str, type[np.floating]] = {"tensor(float)": np.float32, "tensor(float16)": np.float16}
# Bounds of a fixed input size; outside them the network is misread, broken or hostile.
_MIN_SIDE_PX, _MAX_INPUT_PX = 8, 2**26
_MAX_SECONDS = 600.0  # of a run
_MM = {"m": 1000.0, "mm": 1.0}

# Operators whose number of steps the file sets, as the field op_type (number 4) of a node in ONNX's protocol
# buffers: exports of depth networks have none, and a loop need not end.
_LOOPS = {b'"\x04Loop': "Loop", b'"\x04Scan': "Scan"}
_BLOCK_BYTES = 2**24
_TOKENS = "num_tokens"  # additional input of networks that sets their resolution


class DepthEstimator:
    """Estimator of disparity on the CPU.

    An untrusted file can use up memory, and ten minutes, but ONNX Runtime executes no code from it and, since
    version 1.24.1, reads no other files than weights in its folder. Networks with loops are refused.

    Args:
        model: ONNX file with one picture as its input, and the map as output according to the convention.
            External weights must be in its folder.
        convention: Input and output format of the network.
        threads: Threads inside the network; 0 uses all cores.

    Raises:
        ModelFileError: The file is missing or no ONNX file, or the network's input is not a picture.
    """

    def __init__(self, model: Path | str, convention: DepthConvention, threads: int = 0) -> None:
        self._path, self._convention = Path(model), convention
        if not self._path.is_file():
            actual = "a folder" if self._path.is_dir() else "no such file"
            raise ModelFileError(f"{model}: expected an ONNX file, found {actual}")
        options = {"intra_op_num_threads": threads, "log_severity_level": 4}  # errors come as exceptions
        _check_operators(self._path)
        try:
            self._session = OnnxSession(str(self._path), options=options)
        except Exception as error:  # the runtime's exceptions have no common base
            raise ModelFileError(f"{model}: not a usable ONNX file: {_one_line(error)}") from error
        with errors_of_file(model, "a depth network", ModelFileError):
            self._name, self._dtype, self._fixed = self._check_input()
            self._outputs = self._check_outputs()

    @property
    def metric(self) -> bool:
        """True if :meth:`__call__` returns 1/mm."""
        return self._convention.unit != "none"

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """Return the disparity of a picture; near is large.

        The network's map is resized to the picture by cubic interpolation; ``DisparityRepair`` sharpens the
        soft edges.

        Args:
            image: Picture, scene-linear, (H, W, 3).

        Returns:
            Disparity, (H, W) float32: 1/mm if :attr:`metric`, else normalised to 0 to 1. Depth up to scale
            and shift is inverted, 1 - depth.

        Raises:
            ModelFileError: The network fails, or does not return a map of finite numbers, positive for
                metric depth.
            ShapeError, ParameterError: The picture has the wrong shape or invalid values.
        """
        check_image("image", image)
        height, width = image.shape[:2]
        batch = self._convention.prepare(image, *self._convention.input_size(height, width, self._fixed))
        arrays: dict[str, np.ndarray] = {self._name: batch.astype(self._dtype)}
        if self._convention.tokens is not None:
            arrays[_TOKENS] = np.array(self._convention.tokens, np.int64)
        try:
            results = dict(
                zip(self._outputs, self._session.run(arrays, max_seconds=_MAX_SECONDS), strict=True)
            )
        except Exception as error:
            raise ModelFileError(f"{self._path}: the network failed: {_one_line(error)}") from error
        with errors_of_file(self._path, "a depth network", ModelFileError):
            return resample(self._disparity(*self._map(results)), height, width)

    def _check_input(self) -> tuple[str, type[np.floating], tuple[int | None, int | None]]:
        """Return name, type and fixed height and width of the input; raise unless it is a picture."""
        inputs, layout = self._session.inputs(), self._convention.layout
        if self._convention.tokens is not None:
            inputs = [item for item in inputs if item.name != _TOKENS]
        if len(inputs) != 1:
            names = ", ".join(item.name for item in inputs) or "none"
            raise ModelFileError(f"{self._path}: expected one input, a picture, found {len(inputs)}: {names}")
        shape = inputs[0].shape
        actual = f"{inputs[0].name} of shape {tuple(shape)} and {inputs[0].type}"
        if inputs[0].type not in _TYPES or len(shape) != 4:
            raise ModelFileError(
                f"{self._path}: expected a picture {layout} of floats as input, found {actual}"
            )
        sizes = dict(zip(layout, (size if isinstance(size, int) else None for size in shape), strict=True))
        if sizes["C"] not in (3, None) or sizes["N"] not in (1, None):
            raise ModelFileError(f"{self._path}: expected one picture {layout} of 3 channels, found {actual}")
        fixed = [size for size in (sizes["H"], sizes["W"]) if size is not None]
        if min(fixed, default=_MIN_SIDE_PX) < _MIN_SIDE_PX or math.prod(fixed) > _MAX_INPUT_PX:
            raise ModelFileError(
                f"{self._path}: expected a picture {layout} of a sensible size, found {actual}"
            )
        return inputs[0].name, _TYPES[inputs[0].type], (sizes["H"], sizes["W"])

    def _check_outputs(self) -> list[str]:
        """Return the names of the outputs; raise unless they include those of the convention."""
        names = [item.name for item in self._session.outputs()]
        for required in (self._convention.map, self._convention.scale, self._convention.mask):
            if required and required not in names:
                raise ModelFileError(
                    f"{self._path}: expected an output {required}, found {', '.join(names)}; "
                    "is it the right convention?"
                )
        return names

    def _map(self, results: dict[str, Any]) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the map in the outputs, (h, w), double precision, and the mask of surfaces."""
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
        """Return a point map, (3, h, w); the coordinates may be the first or the last axis."""
        shape = np.shape(result)
        if isinstance(result, np.ndarray) and result.dtype.kind == "f" and len(shape) == 4 and shape[0] == 1:
            if shape[1] == 3:
                return self._finite(result[0].astype(np.float64))
            if shape[3] == 3:
                return self._finite(result[0].transpose(2, 0, 1).astype(np.float64))
        raise ModelFileError(f"{self._path}: expected a point map as {name}, found shape {shape}")

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


def _check_operators(path: Path) -> None:
    """Raise if a network contains loops."""
    with path.open("rb") as file:
        tail = b""
        while block := file.read(_BLOCK_BYTES):
            for mark, operator in _LOOPS.items():
                if mark in tail + block:
                    raise ModelFileError(
                        f"{path}: expected a network without loops, found the operator {operator}; export it "
                        "with a fixed number of steps"
                    )
            tail = block[-8:]


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())

"""Results of ONNX nodes that are written like arrays: operators, casts, cuts, sums.

Each operator adds a node to the graph that is open. Sizes are int64 of shape (1,).
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from onnx import TensorProto

if TYPE_CHECKING:
    from bokehnet.onnx_file.builder import Graph

__all__ = ["END", "TYPES", "Operand", "Value"]

# As the end of a cut: whatever the length.
END = 2**62

# Numbers stand for constants of the other operand's type.
Operand = Any

TYPES = {
    np.dtype(np.float32): TensorProto.FLOAT,
    np.dtype(np.float64): TensorProto.DOUBLE,
    np.dtype(np.int16): TensorProto.INT16,
    np.dtype(np.int64): TensorProto.INT64,
    np.dtype(np.bool_): TensorProto.BOOL,
}


class Value:
    """A named result of a graph.

    Attributes:
        name: Unique in the whole file.
        dtype: Of its elements.
        sequence: Whether it is a sequence of arrays.
    """

    def __init__(self, graph: "Graph", name: str, dtype: Any, sequence: bool = False) -> None:
        self.graph, self.name, self.dtype, self.sequence = graph, name, np.dtype(dtype), sequence

    def _with(self, op: str, other: Operand, dtype: Any = None) -> "Value":
        return self.graph.op(op, self, self.graph.constant(other, self.dtype), dtype=dtype)

    def _after(self, op: str, other: Operand) -> "Value":
        return self.graph.op(op, self.graph.constant(other, self.dtype), self)

    def __add__(self, other: Operand) -> "Value":
        return self._with("Add", other)

    def __sub__(self, other: Operand) -> "Value":
        return self._with("Sub", other)

    def __rsub__(self, other: Operand) -> "Value":
        return self._after("Sub", other)

    def __mul__(self, other: Operand) -> "Value":
        return self._with("Mul", other)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Operand) -> "Value":
        return self._with("Div", other)

    def __rtruediv__(self, other: Operand) -> "Value":
        return self._after("Div", other)

    def __floordiv__(self, other: Operand) -> "Value":
        """Of sizes, which are not negative: there the operator truncates, and that is the same."""
        assert self.dtype == np.int64
        return self._with("Div", other)

    def __mod__(self, other: Operand) -> "Value":
        return self._with("Mod", other)

    def __pow__(self, other: Operand) -> "Value":
        return self._with("Pow", other)

    def __neg__(self) -> "Value":
        return self.graph.op("Neg", self)

    def __abs__(self) -> "Value":
        return self.graph.op("Abs", self)

    def __gt__(self, other: Operand) -> "Value":
        return self._with("Greater", other, bool)

    def __ge__(self, other: Operand) -> "Value":
        return self._with("GreaterOrEqual", other, bool)

    def __lt__(self, other: Operand) -> "Value":
        return self._with("Less", other, bool)

    def __le__(self, other: Operand) -> "Value":
        return self._with("LessOrEqual", other, bool)

    def equals(self, other: Operand) -> "Value":
        """Where it equals ``other``; ``==`` keeps its meaning in Python."""
        return self._with("Equal", other, bool)

    def __and__(self, other: "Value") -> "Value":
        return self._with("And", other)

    def __or__(self, other: "Value") -> "Value":
        return self._with("Or", other)

    def __invert__(self) -> "Value":
        return self.graph.op("Not", self)

    def astype(self, dtype: Any) -> "Value":
        """Cast; to integers it cuts towards 0."""
        return self.graph.op("Cast", self, dtype=dtype, to=TYPES[np.dtype(dtype)])

    def size(self, axis: int) -> "Value":
        """Length of an axis, counted from 0."""
        return self.graph.op("Shape", self, dtype=np.int64, start=axis, end=axis + 1)

    def reshape(self, *sizes: Operand) -> "Value":
        """Sizes are numbers or values; -1 stands for the rest."""
        # An axis of length 0 is kept as such, not copied from the input.
        return self.graph.op("Reshape", self, self.graph.sizes(*sizes), allowzero=int(-1 not in sizes))

    def cut(self, axis: int, start: Operand, end: Operand, step: int = 1) -> "Value":
        """Part of an axis, as ``[start:end:step]``; what lies beyond the ends is left out."""
        places = [self.graph.sizes(place) for place in (start, end, axis, step)]
        return self.graph.op("Slice", self, *places)

    def take(self, indices: "Value", axis: int = 0) -> "Value":
        """Elements at ``indices`` along an axis."""
        return self.graph.op("Gather", self, indices, axis=axis)

    def transpose(self, *axes: int) -> "Value":
        """Axes in a new order."""
        return self.graph.op("Transpose", self, perm=list(axes))

    def _reduce(self, op: str, axes: Sequence[int], keep: bool) -> "Value":
        return self.graph.op(op, self, self.graph.sizes(*axes), keepdims=int(keep))

    def max(self, *axes: int, keep: bool = False) -> "Value":
        """Largest along axes; over all of them as shape (1,)."""
        return self._reduce("ReduceMax", axes, keep) if axes else self.reshape(-1).max(0, keep=True)

    def min(self, *axes: int, keep: bool = False) -> "Value":
        """Smallest along axes; over all of them as shape (1,)."""
        return self._reduce("ReduceMin", axes, keep) if axes else self.reshape(-1).min(0, keep=True)

    def sum(self, *axes: int, keep: bool = False) -> "Value":
        """Sum along axes; over all of them as shape (1,)."""
        return self._reduce("ReduceSum", axes, keep) if axes else self.reshape(-1).sum(0, keep=True)

    def mean(self, *axes: int) -> "Value":
        """Mean along axes, which go."""
        return self._reduce("ReduceMean", axes, False)

    def any(self) -> "Value":
        """Whether one is true, as shape (1,)."""
        return self.astype(np.float32).max() > 0

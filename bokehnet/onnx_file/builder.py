"""ONNX graphs in the style of array code: values with operators, loops and branches as functions.

A :class:`Value` is a named result of a :class:`Graph`. Each operator on it adds a node to that graph, so both
are in one file. Nodes are added to the open graph: the body of a loop while that is written, else the
main graph. Constants and sizes are values as well. Sizes are int64 of shape (1,).
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import onnx
from onnx import NodeProto, TensorProto, helper, numpy_helper

__all__ = ["END", "OPSET", "Graph", "Operand", "Value"]

OPSET = 20

_IR_VERSION = 10

# End of a slice of any length.
END = 2**62

# A number is converted to a constant of the other operand's type.
Operand = Any

_TYPES = {
    np.dtype(np.float32): TensorProto.FLOAT,
    np.dtype(np.float64): TensorProto.DOUBLE,
    np.dtype(np.int16): TensorProto.INT16,
    np.dtype(np.int64): TensorProto.INT64,
    np.dtype(np.bool_): TensorProto.BOOL,
}


class Value:
    """Named result of a graph.

    Attributes:
        name: Unique in the whole file.
        dtype: Type of its elements.
        sequence: True for a sequence of arrays.
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
        """Divide sizes, which are not negative: there the operator's truncation equals the floor."""
        assert self.dtype == np.int64
        return self._with("Div", other)

    def __mod__(self, other: Operand) -> "Value":
        return self._with("Mod", other)

    def __pow__(self, other: Operand) -> "Value":
        return self._with("Pow", other)

    def __matmul__(self, other: Operand) -> "Value":
        return self._with("MatMul", other)

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
        """Return the mask of elements equal to ``other``; ``==`` keeps its meaning in Python."""
        return self._with("Equal", other, bool)

    def __and__(self, other: "Value") -> "Value":
        return self._with("And", other)

    def __or__(self, other: "Value") -> "Value":
        return self._with("Or", other)

    def __invert__(self) -> "Value":
        return self.graph.op("Not", self)

    def __array_namespace__(self) -> "Graph":
        """Return the graph, the namespace of its values: :func:`bokehnet.checks.array_namespace`."""
        return self.graph

    def clip(self, min: Operand = None, max: Operand = None) -> "Value":
        """Clip to ``min`` and ``max``."""
        result = self if min is None else self.graph.maximum(self, min)
        return result if max is None else self.graph.minimum(result, max)

    def astype(self, dtype: Any) -> "Value":
        """Cast; to integers it truncates towards 0."""
        return self.graph.op("Cast", self, dtype=dtype, to=_TYPES[np.dtype(dtype)])

    def size(self, axis: int) -> "Value":
        """Return the length of an axis, counted from 0."""
        return self.graph.op("Shape", self, dtype=np.int64, start=axis, end=axis + 1)

    def reshape(self, *sizes: Operand) -> "Value":
        """Reshape to sizes, which are numbers or values; -1 is inferred."""
        # An axis of length 0 is kept as such, not copied from the input.
        return self.graph.op("Reshape", self, self.graph.sizes(*sizes), allowzero=int(-1 not in sizes))

    def cut(self, axis: int, start: Operand, end: Operand, step: int = 1) -> "Value":
        """Return a part of an axis, as ``[start:end:step]``, clipped to its length."""
        bounds = [self.graph.sizes(bound) for bound in (start, end, axis, step)]
        return self.graph.op("Slice", self, *bounds)

    def take(self, indices: "Value", axis: int = 0) -> "Value":
        """Return the elements at ``indices`` along an axis."""
        return self.graph.op("Gather", self, indices, axis=axis)

    def transpose(self, *axes: int) -> "Value":
        """Return the array with its axes in a new order."""
        return self.graph.op("Transpose", self, perm=list(axes))

    def _reduce(self, op: str, axes: Sequence[int], keep: bool) -> "Value":
        return self.graph.op(op, self, self.graph.sizes(*axes), keepdims=int(keep))

    def max(self, *axes: int, keep: bool = False) -> "Value":
        """Return the maximum along axes; over all of them as shape (1,)."""
        return self._reduce("ReduceMax", axes, keep) if axes else self.reshape(-1).max(0, keep=True)

    def min(self, *axes: int, keep: bool = False) -> "Value":
        """Return the minimum along axes; over all of them as shape (1,)."""
        return self._reduce("ReduceMin", axes, keep) if axes else self.reshape(-1).min(0, keep=True)

    def sum(self, *axes: int, keep: bool = False) -> "Value":
        """Return the sum along axes; over all of them as shape (1,)."""
        return self._reduce("ReduceSum", axes, keep) if axes else self.reshape(-1).sum(0, keep=True)

    def mean(self, *axes: int) -> "Value":
        """Return the mean along axes, which are removed."""
        return self._reduce("ReduceMean", axes, False)

    def any(self) -> "Value":
        """Return whether any element is true, as shape (1,)."""
        return self.astype(np.float32).max() > 0


class Graph:
    """ONNX graph that grows node by node."""

    def __init__(self) -> None:
        self._open: list[list[NodeProto]] = [[]]
        self._count = 0
        self._constants: dict[tuple, Value] = {}
        self._initializers: list[TensorProto] = []
        self._inputs: list[onnx.ValueInfoProto] = []

    def _name(self, kind: str) -> str:
        self._count += 1
        return f"{kind}_{self._count}"

    def constant(self, content: Operand, dtype: Any = None) -> Value:
        """Return a number or array as a value; values are returned unchanged."""
        if isinstance(content, Value):
            return content
        array = np.asarray(content, dtype)
        key = (array.dtype, array.shape, array.tobytes())
        if key not in self._constants:
            value = Value(self, self._name("constant"), array.dtype)
            self._constants[key] = value
            self._initializers.append(numpy_helper.from_array(array, value.name))
        return self._constants[key]

    def sizes(self, *parts: Operand) -> Value:
        """Return numbers and values of shape (1,) as one list of int64."""
        if not any(isinstance(part, Value) for part in parts):
            return self.constant(parts, np.int64)
        return self.concat(
            [self.constant(part if isinstance(part, Value) else [part], np.int64) for part in parts]
        )

    def input(self, name: str, dtype: Any, shape: Sequence[str | int] | None) -> Value:
        """Add an input of the file; without a shape it accepts any."""
        self._inputs.append(helper.make_tensor_value_info(name, _TYPES[np.dtype(dtype)], shape))
        return Value(self, name, dtype)

    def optional_input(self, name: str, default: np.ndarray, shape: Sequence[str | int] | None) -> Value:
        """Add an input of the file that has a default."""
        self._initializers.append(numpy_helper.from_array(default, name))
        return self.input(name, default.dtype, shape)

    def ops(self, op: str, *inputs: Value, dtypes: Sequence[Any], **attributes: Any) -> list[Value]:
        """Add a node with one result for each of ``dtypes``."""
        results = [Value(self, self._name(op.lower()), dtype) for dtype in dtypes]
        names = [x.name for x in inputs]
        self._open[-1].append(helper.make_node(op, names, [r.name for r in results], **attributes))
        return results

    def op(self, op: str, *inputs: Value, dtype: Any = None, **attributes: Any) -> Value:
        """Add a node with one result, by default of the first input's type."""
        return self.ops(op, *inputs, dtypes=[dtype or inputs[0].dtype], **attributes)[0]

    def where(self, condition: Value, a: Operand, b: Operand) -> Value:
        """Return ``a`` where ``condition``, else ``b``; one of them is a value."""
        dtype = next(x.dtype for x in (a, b) if isinstance(x, Value))
        return self.op("Where", condition, self.constant(a, dtype), self.constant(b, dtype), dtype=dtype)

    def minimum(self, a: Value, b: Operand) -> Value:
        """Return the smaller of both."""
        return self.op("Min", a, self.constant(b, a.dtype))

    def maximum(self, a: Value, b: Operand) -> Value:
        """Return the larger of both."""
        return self.op("Max", a, self.constant(b, a.dtype))

    def tanh(self, x: Value) -> Value:
        """Return the hyperbolic tangent."""
        return self.op("Tanh", x)

    def floor(self, x: Value) -> Value:
        """Return the largest whole numbers not above x."""
        return self.op("Floor", x)

    def round(self, x: Value) -> Value:
        """Return the nearest whole numbers, halves to even."""
        return self.op("Round", x)

    def log1p(self, x: Value) -> Value:
        """Return the logarithm of 1 + x."""
        return self.op("Log", x + 1)

    def expm1(self, x: Value) -> Value:
        """Return the exponential of x minus 1."""
        return self.op("Exp", x) - 1

    def concat(self, values: Sequence[Value], axis: int = 0) -> Value:
        """Join along an axis."""
        return self.op("Concat", *values, axis=axis)

    def zeros(self, dtype: Any, *sizes: Operand) -> Value:
        """Return an array of zeros."""
        content = numpy_helper.from_array(np.zeros(1, dtype))
        return self.op("ConstantOfShape", self.sizes(*sizes), dtype=dtype, value=content)

    def sorted(self, values: Value, count: Value | None = None) -> tuple[Value, Value]:
        """Return the ``count`` largest of (N,), default all, in descending order, and their indices."""
        count = values.size(0) if count is None else count
        largest, indices = self.ops("TopK", values, count, dtypes=[values.dtype, np.int64], axis=0)
        return largest, indices

    def count_up(self, length: Value) -> Value:
        """Return 0, 1, ... up to below ``length``, int64."""
        return self.op("Range", self.constant(0, np.int64), self.scalar(length), self.constant(1, np.int64))

    def scalar(self, value: Value) -> Value:
        """Return one element as shape ()."""
        return self.op("Squeeze", value, self.sizes(0))

    def empty_sequence(self) -> Value:
        """Return an empty sequence of float32 arrays."""
        result = self.op("SequenceEmpty", dtype=np.float32)
        result.sequence = True
        return result

    def append(self, sequence: Value, value: Value) -> Value:
        """Return the sequence with one more array."""
        result = self.op("SequenceInsert", sequence, value)
        result.sequence = True
        return result

    def at(self, sequence: Value, index: Value) -> Value:
        """Return an array of the sequence."""
        return self.op("SequenceAt", sequence, index)

    def none(self) -> Value:
        """Return the value of an omitted input."""
        return Value(self, "", np.float32)

    @contextmanager
    def _body(self) -> Iterator[list[NodeProto]]:
        self._open.append([])
        yield self._open[-1]
        self._open.pop()

    def _close(
        self, nodes: list[NodeProto], inputs: Sequence[onnx.ValueInfoProto], outputs: Sequence[Value]
    ) -> onnx.GraphProto:
        """Return a body with these results; an extra node produces each, as the standard requires."""
        renamed = [Value(self, self._name("result"), x.dtype, x.sequence) for x in outputs]
        identities = [
            helper.make_node("Identity", [x.name], [n.name]) for x, n in zip(outputs, renamed, strict=True)
        ]
        return helper.make_graph(
            [*nodes, *identities], self._name("body"), list(inputs), [_info(x) for x in renamed]
        )

    def loop(
        self,
        body: Callable[..., tuple[Sequence[Value], Sequence[Value]]],
        state: Sequence[Value],
        times: Value | None = None,
        while_true: bool = False,
    ) -> list[Value]:
        """Repeat ``body``.

        Args:
            body: Function of the iteration number, shape (), and the state, that returns the new state and
                the values to collect in every iteration. With ``while_true`` the first of the new state, a
                bool, decides whether the loop continues.
            state: Initial state; its arrays may change their sizes.
            times: Maximum number of iterations, shape (1,).
            while_true: True if the first of the state decides.

        Returns:
            The final state, then the collected values, each with the iterations as its first axis.
        """
        iteration, continues = (
            Value(self, self._name("turn"), np.int64),
            Value(self, self._name("go_on"), bool),
        )
        loop_state = [Value(self, self._name("held"), x.dtype, x.sequence) for x in state]
        with self._body() as nodes:
            new_state, collected = body(iteration, *loop_state)
            next_condition = self.scalar(new_state[0]) if while_true else continues
            infos = [
                helper.make_tensor_value_info(iteration.name, TensorProto.INT64, ()),
                helper.make_tensor_value_info(continues.name, TensorProto.BOOL, ()),
                *map(_info, loop_state),
            ]
            graph = self._close(nodes, infos, [next_condition, *new_state, *collected])
        results = [Value(self, self._name("loop"), x.dtype, x.sequence) for x in (*new_state, *collected)]
        start = self.scalar(state[0]).name if while_true else ""
        names = [times.name if times else "", start, *(x.name for x in state)]
        self._open[-1].append(helper.make_node("Loop", names, [r.name for r in results], body=graph))
        return results

    def branch(self, condition: Value, yes: Callable[[], Value], no: Callable[[], Value]) -> Value:
        """Return ``yes()`` if ``condition``, of shape (1,), else ``no()``; only that one is evaluated."""
        graphs = []
        for make in (yes, no):
            with self._body() as nodes:
                result = make()
                graphs.append(self._close(nodes, [], [result]))
        return self.op("If", condition, dtype=result.dtype, then_branch=graphs[0], else_branch=graphs[1])

    def inline(self, network: onnx.ModelProto, inputs: dict[str, Value]) -> list[Value]:
        """Write another file's nodes to this graph, and return its outputs.

        Args:
            network: Model of the same operator set, with float32 outputs.
            inputs: Its inputs by name; names without an input are ignored.
        """
        prefix = self._name("network")
        input_names = {item.name for item in network.graph.input}
        renamed = {name: value.name for name, value in inputs.items() if name in input_names} | {"": ""}
        for tensor in network.graph.initializer:
            value = self.constant(numpy_helper.to_array(tensor))
            renamed[tensor.name] = value.name
        for node in network.graph.node:
            copy = NodeProto()
            copy.CopyFrom(node)
            copy.name = ""
            copy.input[:] = [renamed[name] for name in node.input]
            for name in node.output:
                renamed.setdefault(name, f"{prefix}_{name}")
            copy.output[:] = [renamed[name] for name in node.output]
            self._open[-1].append(copy)
        return [Value(self, renamed[item.name], np.float32) for item in network.graph.output]

    def model(
        self, outputs: dict[str, tuple[Value, Sequence[str | int] | None]], **about: str
    ) -> onnx.ModelProto:
        """Return the whole graph as a model.

        Args:
            outputs: Values with their shapes, by name.
            about: Entries for the file's metadata.
        """
        assert len(self._open) == 1
        nodes, infos = self._open[0], []
        for name, (value, shape) in outputs.items():
            nodes.append(helper.make_node("Identity", [value.name], [name]))
            infos.append(helper.make_tensor_value_info(name, _TYPES[value.dtype], shape))
        graph = helper.make_graph(nodes, "bokehnet", self._inputs, infos, self._initializers)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)])
        model.ir_version = _IR_VERSION
        helper.set_model_props(model, about)
        return model


def _info(value: Value) -> onnx.ValueInfoProto:
    """Return name and type of a value, of any shape."""
    kind = _TYPES[value.dtype]
    if value.sequence:
        return helper.make_tensor_sequence_value_info(value.name, kind, None)
    return helper.make_tensor_value_info(value.name, kind, None)

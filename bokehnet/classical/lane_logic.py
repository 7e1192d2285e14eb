"""Comparisons, choices and table look-ups for the eight numbers of :mod:`bokehnet.classical.lanes`."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import models, register_model

from bokehnet.classical.lanes import LANES, LanesType, intrinsic, larger, smaller, splat

__all__ = [
    "any_lane",
    "both",
    "choose_lanes",
    "divide_lanes",
    "floor_lanes",
    "larger_lanes",
    "less",
    "load_pairs",
    "load_triples",
    "magnitude_lanes",
    "smaller_lanes",
    "without",
]

_INT = ir.IntType(32)


class MaskType(types.Type):
    """Eight answers, yes or no."""

    def __init__(self) -> None:
        super().__init__(name="Mask")


_mask = MaskType()


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), LANES))


@intrinsic
def less(_, a, b):  # type: ignore[no-untyped-def]
    """Where ``a < b``."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fcmp_ordered("<", *arguments)

    return _mask(a, b), generate


@intrinsic
def both(_, a, b):  # type: ignore[no-untyped-def]
    """Where both masks hold."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.and_(*arguments)

    return _mask(a, b), generate


@intrinsic
def without(_, a, b):  # type: ignore[no-untyped-def]
    """Where mask ``a`` holds and ``b`` does not."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.and_(arguments[0], builder.not_(arguments[1]))

    return _mask(a, b), generate


@intrinsic
def any_lane(_, mask):  # type: ignore[no-untyped-def]
    """Whether a mask holds anywhere."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        whole = builder.bitcast(arguments[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", whole, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(mask), generate


@intrinsic
def choose_lanes(_, mask, a, b):  # type: ignore[no-untyped-def]
    """``a`` where the mask holds, ``b`` elsewhere."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.select(*arguments)

    return a(mask, a, b), generate


@intrinsic
def smaller_lanes(_, a, b):  # type: ignore[no-untyped-def]
    """The smaller of both."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return smaller(builder, *arguments)

    return a(a, b), generate


@intrinsic
def larger_lanes(_, a, b):  # type: ignore[no-untyped-def]
    """The larger of both."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return larger(builder, *arguments)

    return a(a, b), generate


@intrinsic
def divide_lanes(_, a, b):  # type: ignore[no-untyped-def]
    """``a / b``; division by zero is not checked."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fdiv(*arguments)

    return a(a, b), generate


def _apply(name: str) -> Any:
    """A function of one vector that LLVM knows by ``name``."""

    @intrinsic
    def compute(_, lanes):  # type: ignore[no-untyped-def]
        def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            (value,) = arguments
            suffix = {"float": "f32", "double": "f64"}[str(value.type.element)]
            kind = ir.FunctionType(value.type, [value.type])
            known = f"llvm.{name}.v{LANES}{suffix}"
            module = builder.module
            function = module.globals.get(known) or ir.Function(module, kind, known)
            return builder.call(function, [value])

        return lanes(lanes), generate

    return compute


floor_lanes = _apply("floor")
magnitude_lanes = _apply("fabs")


def _pixels(builder: Any, rows: Any, columns: Any, width: Any) -> Any:
    """``row * width + column`` of whole numbers held as floating point, below 2^31, as eight integers."""
    rows, columns = (builder.fptosi(value, ir.VectorType(_INT, LANES)) for value in (rows, columns))
    return builder.add(builder.mul(rows, splat(builder, builder.trunc(width, _INT))), columns)


@intrinsic
def load_pairs(_, array, rows, columns, width, stride, offset):  # type: ignore[no-untyped-def]
    """Two neighbouring numbers of a table for each lane, as a tuple of two lanes.

    Args:
        _: Given by numba.
        array: Contiguous, one axis.
        rows: Whole numbers, as floating point; no bounds are checked.
        columns: Likewise.
        width: Places in a row.
        stride: Numbers in a place.
        offset: Which of them come first.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, rows, columns, width, stride, offset = arguments
        data = context.make_array(signature.args[0])(context, builder, array).data
        element = context.get_value_type(signature.args[0].dtype)
        pair = ir.VectorType(element, 2)
        pixels = _pixels(builder, rows, columns, width)
        pairs = []
        for lane in range(LANES):
            pixel = builder.sext(builder.extract_element(pixels, ir.Constant(_INT, lane)), width.type)
            place = builder.add(builder.mul(pixel, stride), offset)
            loaded = builder.load(builder.bitcast(builder.gep(data, [place]), pair.as_pointer()))
            loaded.align = context.get_abi_sizeof(element)
            pairs.append(loaded)
        while len(pairs) > 1:  # join neighbours
            length = pairs[0].type.count
            order = ir.Constant(
                ir.VectorType(_INT, 2 * length), [ir.Constant(_INT, i) for i in range(2 * length)]
            )
            pairs = [
                builder.shuffle_vector(a, b, order) for a, b in zip(pairs[::2], pairs[1::2], strict=True)
            ]
        split = []
        for first in (0, 1):
            order = ir.Constant(pixels.type, [ir.Constant(_INT, first + 2 * lane) for lane in range(LANES)])
            split.append(builder.shuffle_vector(pairs[0], pairs[0], order))
        return context.make_tuple(builder, signature.return_type, split)

    kind = LanesType(array.dtype)
    return types.UniTuple(kind, 2)(array, rows, columns, types.intp, types.intp, types.intp), generate


@intrinsic
def load_triples(_, array, rows, columns, places, width, count):  # type: ignore[no-untyped-def]
    """Three neighbouring numbers of a table for each lane, as a tuple of three lanes.

    Args:
        _: Given by numba.
        array: Contiguous, (rows, width, count, 3), as one axis.
        rows: Whole numbers, as floating point; no bounds are checked.
        columns: Likewise.
        places: Likewise.
        width: Columns of the table.
        count: Places in a column.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, rows, columns, places, width, count = arguments
        data = context.make_array(signature.args[0])(context, builder, array).data
        element = context.get_value_type(signature.args[0].dtype)
        pixels = _pixels(builder, rows, columns, width)
        places = builder.fptosi(places, pixels.type)
        triples = [ir.Constant(ir.VectorType(element, LANES), ir.Undefined) for _ in range(3)]
        three = ir.Constant(width.type, 3)
        for lane in range(LANES):
            at = ir.Constant(_INT, lane)
            pixel, place = (
                builder.sext(builder.extract_element(value, at), width.type) for value in (pixels, places)
            )
            first = builder.mul(builder.add(builder.mul(pixel, count), place), three)
            for i in range(3):
                number = builder.load(builder.gep(data, [builder.add(first, ir.Constant(width.type, i))]))
                number.align = context.get_abi_sizeof(element)
                triples[i] = builder.insert_element(triples[i], number, at)
        return context.make_tuple(builder, signature.return_type, triples)

    kind = LanesType(array.dtype)
    return types.UniTuple(kind, 3)(array, rows, columns, places, types.intp, types.intp), generate

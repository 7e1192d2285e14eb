"""Eight numbers in one SIMD register, and masks of eight, for the innermost loops of numba kernels.

They are eight adjacent pixels in ``ORDER``, or two pixels of four channels.

Numba passes plain loops to LLVM's vectoriser, which must first prove at run time that no two arrays
overlap. For rows of 8 to 40 numbers that proof, and the scalar loop next to it, cost more than the work.
These few operations name the vectors explicitly; LLVM maps them to the machine's (one AVX register,
two SSE or NEON ones). ``a * b + c`` is one fused operation where the machine has one.
"""

import operator
from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba import extending, types
from numba.extending import models, overload, register_model

__all__ = [
    "LANES",
    "ORDER",
    "abs8",
    "and8",
    "and_not8",
    "any8",
    "broadcast8",
    "divide8",
    "floor8",
    "gather_pairs8",
    "gather_triples8",
    "indices8",
    "less8",
    "load4_twice",
    "load8",
    "max8",
    "min8",
    "overlap8",
    "overlap_growth8",
    "repeat4",
    "select8",
    "sqrt8",
    "store8",
    "sum8",
    "table_indices",
]

LANES = 8

# Order of a block's pixels in the lanes: even ones in one half of the register, odd ones in the other,
# so that two adjacent pixels are repeated for four channels each without crossing from half to half.
ORDER = (0, 2, 4, 6, 1, 3, 5, 7)

# Called with one argument less than in the definition, which a type checker cannot know.
intrinsic: Any = extending.intrinsic


class Float8(types.Type):
    """Eight numbers of one floating-point type."""

    def __init__(self, dtype: Any) -> None:
        self.dtype = dtype
        super().__init__(name=f"Lanes({dtype})")


@register_model(Float8)
class _Float8Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _vector(manager.lookup(kind.dtype).get_value_type()))


def _vector(element: Any) -> Any:
    return ir.VectorType(element, LANES)


def _constant(element: Any, numbers: Sequence[float]) -> Any:
    return ir.Constant(_vector(element), [ir.Constant(element, number) for number in numbers])


def _splat(builder: Any, scalar: Any) -> Any:
    """Return a number eight times, as an instruction of the function under construction."""
    empty = ir.Constant(_vector(scalar.type), ir.Undefined)
    first = builder.insert_element(empty, scalar, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, empty, _constant(ir.IntType(32), [0] * LANES))


def _address(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Return a pointer to eight elements of a contiguous array, starting at ``index``."""
    data = context.make_array(kind)(context, builder, array).data
    element = context.get_value_type(kind.dtype)
    return builder.bitcast(builder.gep(data, [index]), _vector(element).as_pointer()), element


def _larger(builder: Any, a: Any, b: Any) -> Any:
    """Return the larger of two numbers or vectors, as an instruction of the function under construction."""
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


def _magnitude(builder: Any, value: Any) -> Any:
    return _larger(builder, value, builder.fneg(value))


def _smaller(builder: Any, a: Any, b: Any) -> Any:
    """Return the smaller of two numbers or vectors; see :func:`_larger`."""
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


@intrinsic
def load8(_, array, index):
    """Return eight numbers of the 1-D contiguous ``array`` from ``index`` on; no bounds are checked."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address, element = _address(context, builder, signature.args[0], *arguments)
        loaded = builder.load(address)
        loaded.align = context.get_abi_sizeof(element)
        return loaded

    return Float8(array.dtype)(array, types.intp), generate


@intrinsic
def load4_twice(_, array, index):
    """Return four numbers of the 1-D contiguous ``array`` from ``index`` on, twice; no bounds are checked."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address, element = _address(context, builder, signature.args[0], *arguments)
        four = ir.VectorType(element, LANES // 2)
        loaded = builder.load(builder.bitcast(address, four.as_pointer()))
        loaded.align = context.get_abi_sizeof(element)
        order = _constant(ir.IntType(32), [*range(LANES // 2), *range(LANES // 2)])
        return builder.shuffle_vector(loaded, loaded, order)

    return Float8(array.dtype)(array, types.intp), generate


@intrinsic
def repeat4(_, pixels):
    """Return four lanes: pixels 0 and 1 of a block four times each, then 2 and 3, and so on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        (value,) = arguments
        pairs = []
        for pixel in range(0, LANES, 2):
            order = [ORDER.index(pixel)] * 4 + [ORDER.index(pixel + 1)] * 4
            pairs.append(builder.shuffle_vector(value, value, _constant(ir.IntType(32), order)))
        return context.make_tuple(builder, signature.return_type, pairs)

    return types.UniTuple(pixels, 4)(pixels), generate


@intrinsic
def store8(_, array, index, lanes):
    """Write eight numbers to the 1-D contiguous ``array`` from ``index`` on; no bounds are checked."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address, element = _address(context, builder, signature.args[0], *arguments[:2])
        builder.store(arguments[2], address).align = context.get_abi_sizeof(element)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), generate


@intrinsic
def broadcast8(_, scalar):
    """Return the same number eight times."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return _splat(builder, arguments[0])

    return Float8(scalar)(scalar), generate


@intrinsic
def indices8(_, first):
    """Return the numbers ``first`` to ``first + 7`` of the pixels of a block."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        steps = _constant(arguments[0].type, [float(pixel) for pixel in ORDER])
        return builder.fadd(_splat(builder, arguments[0]), steps)

    return Float8(first)(first), generate


@intrinsic
def overlap8(_, distance, half):
    """Return the part of pixels at ``distance`` within ``half`` - 1/2: half - |distance| in [0, 1]."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        distance, half = arguments
        zero, one = (_constant(half.type.element, [bound] * LANES) for bound in (0.0, 1.0))
        cover = builder.fsub(half, _magnitude(builder, distance))
        return _smaller(builder, _larger(builder, cover, zero), one)

    return distance(distance, half), generate


@intrinsic
def overlap_growth8(_, distance, half, half_growth, centre_growth):
    """Return the derivative of :func:`overlap8` for the derivatives of ``half`` and the centre; all lanes."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        distance, half, half_growth, centre_growth = arguments
        zero, one = (_constant(half.type.element, [bound] * LANES) for bound in (0.0, 1.0))
        cover = builder.fsub(half, _magnitude(builder, distance))
        ends = (builder.fcmp_ordered(">", cover, zero), builder.fcmp_ordered("<", cover, one))
        right = builder.fcmp_ordered(">", distance, zero)
        growth = builder.select(
            right, builder.fadd(half_growth, centre_growth), builder.fsub(half_growth, centre_growth)
        )
        return builder.select(builder.and_(*ends), growth, zero)

    return distance(distance, half, half_growth, centre_growth), generate


@intrinsic
def sum8(_, lanes):
    """Return the sum of the eight numbers, always added in the same order."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        (value,) = arguments
        half = LANES // 2
        while half:
            order = [(i + half) % LANES for i in range(LANES)]
            value = builder.fadd(
                value,
                builder.shuffle_vector(value, value, _constant(ir.IntType(32), order)),  # type: ignore[arg-type]
            )
            half //= 2
        return builder.extract_element(value, ir.Constant(ir.IntType(32), 0))

    return lanes.dtype(lanes), generate


def _elementwise(instruction: str) -> Any:
    @intrinsic
    def compute(_, a, b):
        def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            return getattr(builder, instruction)(*arguments, flags=("contract",))

        return a(a, b), generate

    return compute


def _overload_operator(symbol: Any, instruction: str) -> None:
    compute = _elementwise(instruction)

    @overload(symbol)
    def choose(a, b):
        both = isinstance(a, Float8) and a == b
        return (lambda a, b: compute(a, b)) if both else None


_overload_operator(operator.add, "fadd")
_overload_operator(operator.sub, "fsub")
_overload_operator(operator.mul, "fmul")

_INT = ir.IntType(32)


class Mask8(types.Type):
    """Eight booleans."""

    def __init__(self) -> None:
        super().__init__(name="Mask")


_mask = Mask8()


@register_model(Mask8)
class _Mask8Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), LANES))


@intrinsic
def less8(_, a, b):
    """Return the mask ``a < b``."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fcmp_ordered("<", *arguments)

    return _mask(a, b), generate


@intrinsic
def and8(_, a, b):
    """Return the conjunction of both masks."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.and_(*arguments)

    return _mask(a, b), generate


@intrinsic
def and_not8(_, a, b):
    """Return the mask of ``a`` without ``b``."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.and_(arguments[0], builder.not_(arguments[1]))

    return _mask(a, b), generate


@intrinsic
def any8(_, mask):
    """Return whether a mask is set in any lane."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        whole = builder.bitcast(arguments[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", whole, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(mask), generate


@intrinsic
def select8(_, mask, a, b):
    """Return ``a`` where the mask is set, ``b`` elsewhere."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.select(*arguments)

    return a(mask, a, b), generate


@intrinsic
def min8(_, a, b):
    """Return the smaller of both."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return _smaller(builder, *arguments)

    return a(a, b), generate


@intrinsic
def max8(_, a, b):
    """Return the larger of both."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return _larger(builder, *arguments)

    return a(a, b), generate


@intrinsic
def divide8(_, a, b):
    """Return ``a / b``; division by zero is not checked."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fdiv(*arguments)

    return a(a, b), generate


def _apply(name: str) -> Any:
    """Return a function of one vector with the LLVM intrinsic ``name``."""

    @intrinsic
    def compute(_, lanes):
        def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            (value,) = arguments
            suffix = {"float": "f32", "double": "f64"}[str(value.type.element)]
            kind = ir.FunctionType(value.type, [value.type])
            intrinsic_name = f"llvm.{name}.v{LANES}{suffix}"
            module = builder.module
            function = module.globals.get(intrinsic_name) or ir.Function(module, kind, intrinsic_name)
            return builder.call(function, [value])

        return lanes(lanes), generate

    return compute


floor8 = _apply("floor")
abs8 = _apply("fabs")
sqrt8 = _apply("sqrt")


def table_indices(builder: Any, rows: Any, columns: Any, width: Any) -> Any:
    """Return ``row * width + column`` of integers in floating point, below 2^31, as eight integers."""
    rows, columns = (builder.fptosi(value, ir.VectorType(_INT, LANES)) for value in (rows, columns))
    return builder.add(builder.mul(rows, _splat(builder, builder.trunc(width, _INT))), columns)


@intrinsic
def gather_pairs8(_, array, rows, columns, width, stride, offset):
    """Return two adjacent numbers of a table for each lane, as a tuple of two lanes.

    Args:
        _: Typing context of numba.
        array: Contiguous, one axis.
        rows: Integers as floating point; no bounds are checked.
        columns: Integers as floating point; no bounds are checked.
        width: Cells per row.
        stride: Numbers per cell.
        offset: Index of the first of the two in its cell.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, rows, columns, width, stride, offset = arguments
        data = context.make_array(signature.args[0])(context, builder, array).data
        element = context.get_value_type(signature.args[0].dtype)
        pair = ir.VectorType(element, 2)
        pixels = table_indices(builder, rows, columns, width)
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

    kind = Float8(array.dtype)
    return types.UniTuple(kind, 2)(array, rows, columns, types.intp, types.intp, types.intp), generate


@intrinsic
def gather_triples8(_, array, rows, columns, places, width, count):
    """Return three adjacent numbers of a table for each lane, as a tuple of three lanes.

    Args:
        _: Typing context of numba.
        array: Contiguous, (rows, width, count, 3), as one axis.
        rows: Integers as floating point; no bounds are checked.
        columns: Integers as floating point; no bounds are checked.
        places: Cells of a column, integers as floating point; no bounds are checked.
        width: Columns of the table.
        count: Cells per column.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, rows, columns, places, width, count = arguments
        data = context.make_array(signature.args[0])(context, builder, array).data
        element = context.get_value_type(signature.args[0].dtype)
        pixels = table_indices(builder, rows, columns, width)
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

    kind = Float8(array.dtype)
    return types.UniTuple(kind, 3)(array, rows, columns, places, types.intp, types.intp), generate

"""Four adjacent float64 numbers at once, for the innermost lines of the kernels.

The compiler does not generate these vector instructions by itself for a loop over four channels; with them,
the loop needs less than half of the time. Any machine can run them: where four do not fit, the compiler
splits.
"""

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import extending, types

__all__ = ["add_interval", "difference", "load4"]

# Called with one argument less than in the definition, which a type checker cannot know.
intrinsic: Any = extending.intrinsic

_DOUBLE4 = ir.VectorType(ir.DoubleType(), 4)


def _lane(index: int) -> Any:
    return ir.Constant(ir.IntType(32), index)


def _pack(builder: Any, numbers: Any) -> Any:
    """Return a tuple of four numbers as a vector."""
    vector = ir.Constant(_DOUBLE4, ir.Undefined)
    for c in range(4):
        vector = builder.insert_element(vector, builder.extract_value(numbers, c), _lane(c))
    return vector


def _splat(builder: Any, number: Any) -> Any:
    """Return one number four times, as a vector."""
    vector = ir.Constant(_DOUBLE4, ir.Undefined)
    for c in range(4):
        vector = builder.insert_element(vector, number, _lane(c))
    return vector


def _address(context: Any, builder: Any, signature: Any, array: Any, index: Any) -> Any:
    """Return the address of ``array[index]``, as that of a vector."""
    data = context.make_array(signature.args[0])(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _DOUBLE4.as_pointer())


@intrinsic
def add_interval(typing_context, array, left, right, strength, numbers):
    """Add ``strength * numbers`` to four elements of ``array`` from ``left`` on; subtract it at ``right``.

    Args:
        typing_context: Typing context of numba.
        array: Contiguous, one axis, float64.
        left: Index, not checked; the four elements must exist.
        right: Index, not checked; the four elements must exist.
        strength: One float64.
        numbers: Tuple of four float64.
    """

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, left, right, strength, numbers = arguments
        product = builder.fmul(_splat(builder, strength), _pack(builder, numbers))
        for index, combine in ((left, builder.fadd), (right, builder.fsub)):
            address = _address(context, builder, signature, array, index)
            builder.store(combine(builder.load(address, align=8), product), address, align=8)
        return context.get_dummy_value()

    return types.void(array, left, right, strength, numbers), codegen


def _unpack(context: Any, builder: Any, signature: Any, vector: Any) -> Any:
    """Return a vector as a tuple of four numbers."""
    numbers = ir.Constant(context.get_value_type(signature.return_type), ir.Undefined)
    for c in range(4):
        numbers = builder.insert_value(numbers, builder.extract_element(vector, _lane(c)), c)
    return numbers


@intrinsic
def load4(typing_context, array, index):
    """Return ``array[index : index + 4]`` as a tuple; no bounds are checked.

    Args:
        typing_context: Typing context of numba.
        array: Contiguous, one axis, float64.
        index: Not negative.
    """

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vector = builder.load(_address(context, builder, signature, *arguments), align=8)
        return _unpack(context, builder, signature, vector)

    return types.UniTuple(types.float64, 4)(array, index), codegen


@intrinsic
def difference(typing_context, array, left, right):
    """Return ``array[left : left + 4] - array[right : right + 4]`` as a tuple; no bounds are checked.

    Args:
        typing_context: Typing context of numba.
        array: Contiguous, one axis, float64.
        left: Not negative.
        right: Not negative.
    """

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, left, right = arguments
        minuend = builder.load(_address(context, builder, signature, array, left), align=8)
        subtrahend = builder.load(_address(context, builder, signature, array, right), align=8)
        return _unpack(context, builder, signature, builder.fsub(minuend, subtrahend))

    return types.UniTuple(types.float64, 4)(array, left, right), codegen

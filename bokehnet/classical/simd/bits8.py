"""Sets of up to 64 small numbers, one in each lane, as the bits of words that lie in a table."""

from typing import Any

from llvmlite import ir
from numba import extending, types

from bokehnet.classical.simd.float8 import LANES, Mask8, table_indices

__all__ = ["MEMBERS", "meets8"]

# Numbers that a set can hold: 0 to 63.
MEMBERS = 64

# Called with one argument less than it is defined with, which a type checker cannot know.
intrinsic: Any = extending.intrinsic

_WORDS = ir.VectorType(ir.IntType(MEMBERS), LANES)


def _all(number: int) -> Any:
    return ir.Constant(_WORDS, [ir.Constant(_WORDS.element, number)] * LANES)


@intrinsic
def meets8(_, sets, rows, columns, width, first, last):  # type: ignore[no-untyped-def]
    """Where a set holds one of the numbers ``first`` to ``last``, both included.

    Args:
        _: Given by numba.
        sets: Contiguous, one axis, uint64; bit i tells whether i is there.
        rows: Whole numbers, as floating point; no bounds are checked.
        columns: Likewise.
        width: Sets in a row.
        first: 0 to 63, as floating point; what lies behind the point is dropped.
        last: Likewise, not below ``first``.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        sets, rows, columns, width, first, last = arguments
        data = context.make_array(signature.args[0])(context, builder, sets).data
        places = table_indices(builder, rows, columns, width)
        words = ir.Constant(_WORDS, ir.Undefined)
        for lane in range(LANES):
            at = ir.Constant(ir.IntType(32), lane)
            place = builder.sext(builder.extract_element(places, at), width.type)
            words = builder.insert_element(words, builder.load(builder.gep(data, [place])), at)
        integers = ir.VectorType(ir.IntType(32), LANES)
        first, last = (builder.zext(builder.fptosi(value, integers), _WORDS) for value in (first, last))
        wanted = builder.shl(_all(-1), first)
        wanted = builder.and_(wanted, builder.lshr(_all(-1), builder.sub(_all(MEMBERS - 1), last)))
        return builder.icmp_unsigned("!=", builder.and_(words, wanted), _all(0))

    return Mask8()(sets, rows, columns, types.intp, first, last), generate

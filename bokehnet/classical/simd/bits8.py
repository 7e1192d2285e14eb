"""Sets of up to 64 small integers, one per lane, as the bits of words in a table."""

from typing import Any

from llvmlite import ir
from numba import extending, types

from bokehnet.classical.simd.float8 import LANES, Mask8, table_indices

__all__ = ["MEMBERS", "meets8"]

# Size of the domain of a set: 0 to 63.
MEMBERS = 64

# Called with one argument less than in the definition, which a type checker cannot know.
intrinsic: Any = extending.intrinsic

_WORDS = ir.VectorType(ir.IntType(MEMBERS), LANES)


def _broadcast_word(number: int) -> Any:
    return ir.Constant(_WORDS, [ir.Constant(_WORDS.element, number)] * LANES)


@intrinsic
def meets8(_, sets, rows, columns, width, first, last):
    """Return the mask of lanes whose set contains one of ``first`` to ``last``, both inclusive.

    Args:
        _: Typing context of numba.
        sets: Contiguous, one axis, uint64; bit i is set if i is in the set.
        rows: Integers as floating point; no bounds are checked.
        columns: Integers as floating point; no bounds are checked.
        width: Sets per row.
        first: 0 to 63, as floating point; the fraction is truncated.
        last: 0 to 63, not below ``first``; the fraction is truncated.
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
        range_bits = builder.shl(_broadcast_word(-1), first)
        range_bits = builder.and_(
            range_bits, builder.lshr(_broadcast_word(-1), builder.sub(_broadcast_word(MEMBERS - 1), last))
        )
        return builder.icmp_unsigned("!=", builder.and_(words, range_bits), _broadcast_word(0))

    return Mask8()(sets, rows, columns, types.intp, first, last), generate

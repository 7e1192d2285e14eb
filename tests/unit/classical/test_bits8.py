"""Sets in words. Oracle: Python's sets."""

import numpy as np
from numba import njit

from bokehnet.classical.simd.bits8 import MEMBERS, meets8
from bokehnet.classical.simd.float8 import LANES, broadcast8, load8, select8, store8


@njit
def meet(sets, width, rows, columns, first, last):
    result = np.empty(LANES, np.float32)
    where = meets8(sets, load8(rows, 0), load8(columns, 0), width, load8(first, 0), load8(last, 0))
    store8(result, 0, select8(where, broadcast8(np.float32(1)), broadcast8(np.float32(0))))
    return result


def test_a_set_meets_a_range_where_it_holds_a_number_of_it():
    rng = np.random.default_rng(0)
    members = [set(rng.choice(MEMBERS, rng.integers(0, 5), replace=False).tolist()) for _ in range(12)]
    sets = np.array([sum(1 << i for i in held) for held in members], np.uint64)
    outcomes = []
    for _ in range(200):
        rows, columns = rng.integers(0, 3, LANES), rng.integers(0, 4, LANES)
        first, last = np.sort(rng.integers(0, MEMBERS, (2, LANES)), axis=0)
        fractions = [(a + rng.random(LANES) * 0.99).astype(np.float32) for a in (first, last)]
        result = meet(sets, 4, rows.astype(np.float32), columns.astype(np.float32), *fractions)
        held = [members[4 * r + c] for r, c in zip(rows, columns, strict=True)]
        expected = [any(a <= i <= b for i in each) for each, a, b in zip(held, first, last, strict=True)]
        np.testing.assert_array_equal(result.astype(bool), expected)
        outcomes += expected
    assert 0.2 < np.mean(outcomes) < 0.8

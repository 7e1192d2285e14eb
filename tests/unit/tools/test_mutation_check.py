"""Mutants of the mutation check apply to the sources as they are."""

import pytest

from tools.mutation_check import MUTANTS, ROOT


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: f"{mutant.path}:{mutant.after}")
def test_each_mutant_changes_one_expression_and_has_tests(mutant):
    source = (ROOT / "bokehnet" / mutant.path).read_text(encoding="utf-8")
    assert source.count(mutant.before) == 1
    assert mutant.before != mutant.after
    assert (ROOT / "tests/unit" / mutant.tests).exists()


def test_half_of_the_mutants_are_in_kernels():
    kernels = ["njit" in (ROOT / "bokehnet" / mutant.path).read_text(encoding="utf-8") for mutant in MUTANTS]
    assert sum(kernels) == 10
    assert len(kernels) == 20

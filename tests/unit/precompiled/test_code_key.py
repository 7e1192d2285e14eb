"""Keys of kernels: equal exactly where the compiler sees the same.

Authority: the texts, which differ in what is named by each test.
"""

import textwrap

import pytest

from bokehnet.classical.error_map import _cover_discs
from bokehnet.classical.simd import double4
from bokehnet.kernels import njit
from bokehnet.precompiled.code_key import code_key
from bokehnet.precompiled.kernel import KERNELS

TEXT = '''
import math
import numpy as np
WEIGHTS = np.array([1.0, 2.0])
STEPS = (3, 0.5)

def helper(x):
    """Return a root."""
    return math.sqrt(x) + STEPS[0]

@njit
def inner(x):
    return helper(x) * WEIGHTS[0]

@njit(parallel=True)
def kernel(values):
    """Sum up."""
    total = 0.0
    for value in values:
        # every value
        total += inner(value)
    return total
'''


@pytest.fixture
def key_of():
    """Function of a text: the key of the function ``kernel`` that it defines."""
    before = dict(KERNELS)

    def key(text):
        namespace = {"__name__": "bokehnet.made_for_a_test", "njit": njit}
        exec(textwrap.dedent(text), namespace)
        return code_key(namespace["kernel"])

    yield key
    KERNELS.clear()
    KERNELS.update(before)


def test_the_same_text_gives_the_same_key(key_of):
    assert key_of(TEXT) == key_of(TEXT)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("# every value", "# each of them, and\n        # one more line"),
        ('"""Sum up."""', '"""Sum all up.\n\n    With care.\n    """'),
        ('"""Return a root."""', '"""Return a sum."""'),
        ("import math\n", "import math\n\n\n"),
        ("math.sqrt(x) + STEPS[0]", "(math.sqrt(x)\n            + STEPS[0])"),
    ],
)
def test_comments_docstrings_and_layout_do_not_count(key_of, old, new):
    assert old in TEXT
    assert key_of(TEXT.replace(old, new)) == key_of(TEXT)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("total = 0.0", "total = 0.5"),
        ("total +=", "total -="),
        ("math.sqrt", "math.exp"),
        ("* WEIGHTS[0]", "/ WEIGHTS[0]"),
        ("[1.0, 2.0]", "[1.0, 2.5]"),
        ("(3, 0.5)", "(4, 0.5)"),
        ("(3, 0.5)", "(3.0, 0.5)"),
        ("parallel=True", "parallel=False"),
        ("parallel=True", "parallel=True, fastmath=True"),
        ("@njit\ndef inner", "@njit(error_model='numpy')\ndef inner"),
    ],
)
def test_code_of_all_that_is_called_constants_and_options_count(key_of, old, new):
    assert old in TEXT
    assert key_of(TEXT.replace(old, new)) != key_of(TEXT)


def test_values_of_closures_count(key_of):
    text = """
    def make(factor):
        @njit
        def kernel(x):
            return factor * x
        return kernel
    kernel = make(2)
    """
    assert key_of(text) != key_of(text.replace("make(2)", "make(3)"))


def test_a_recursive_kernel_has_a_key(key_of):
    text = """
    @njit
    def kernel(n):
        return n * kernel(n - 1) if n > 1 else 1
    """
    assert key_of(text) != key_of(text.replace("n > 1", "n > 2"))


def test_extensions_of_numba_count_with_their_whole_module(key_of, monkeypatch):
    """Operators are registered there under no name that a kernel could mention."""
    from bokehnet.precompiled import code_key as module

    text = """
    from bokehnet.classical.simd.double4 import load4
    @njit
    def kernel(values):
        return load4(values, 0)
    """
    before = key_of(text)
    other = compile("def another():\n    return 1\n", "double4.py", "exec")
    monkeypatch.setattr(type(double4.__spec__.loader), "get_code", lambda self, name: other)
    module._own_content.cache_clear()
    try:
        assert key_of(text) != before
    finally:
        module._own_content.cache_clear()


def test_kernels_of_the_package_have_keys():
    assert len({code_key(kernel) for kernel in KERNELS.values()}) > 1
    assert len(code_key(_cover_discs)) == 64

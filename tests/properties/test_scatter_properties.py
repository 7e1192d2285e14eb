"""Properties of the scatter for any picture and any defocus."""

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.scatter.pyramid_levels import MERGE_ABOVE, scatter_forward
from bokehnet.classical.scatter_renderer import scatter_inside as scatter
from bokehnet.errors import ParameterError

few = settings(max_examples=25, deadline=None)
sides = st.integers(1, 24)
seeds = st.integers(0, 2**32 - 1)
radii = st.floats(0, 40, allow_subnormal=False)


def draw(seed: int, height: int, width: int, largest: float) -> tuple[np.ndarray, np.ndarray]:
    """A picture and a defocus; large radii are alike, so that levels merge them."""
    rng = np.random.default_rng(seed)
    defocus = largest * (1 - 0.1 * rng.random((height, width)))
    if rng.random() < 0.5:
        defocus = rng.uniform(-largest, largest, (height, width))
    return rng.random((height, width, 3)), defocus


@pytest.mark.slow
@few
@given(seed=seeds, height=sides, width=sides, largest=radii)
def test_light_is_kept_as_far_as_it_falls_into_the_picture(seed, height, width, largest):
    image, defocus = draw(seed, height, width, largest)
    margin = int(largest * 1.3) + 8
    pad = ((margin, margin), (margin, margin))
    values = np.pad(image, (*pad, (0, 0)))
    sums = scatter_forward(values, np.pad(defocus, pad))
    assert_allclose(sums.sum(axis=(0, 1)), image.sum(axis=(0, 1)), rtol=1e-9)


@few
@given(seed=seeds, height=sides, width=sides, strength=st.floats(1e-3, 1e4), sharp=st.floats(-0.5, 0.5))
def test_no_defocus_is_the_identity(seed, height, width, strength, sharp):
    image = (strength * np.random.default_rng(seed).random((height, width, 3))).astype(np.float32)
    assert_array_equal(scatter(image, np.full((height, width), sharp, np.float32)), image)


@few
@given(seed=seeds, height=sides, width=sides, largest=st.floats(0, MERGE_ABOVE))
def test_mirrored_and_transposed_input_gives_mirrored_and_transposed_output(seed, height, width, largest):
    image, defocus = draw(seed, height, width, largest)
    bokeh = scatter(image, defocus)
    for turn in (lambda a: a[::-1], lambda a: a[:, ::-1], lambda a: a.swapaxes(0, 1)):
        assert_allclose(scatter(turn(image), turn(defocus)), turn(bokeh), atol=1e-9)


@few
@given(seed=seeds, rows=st.integers(1, 3), columns=st.integers(1, 3), largest=st.floats(MERGE_ABOVE, 60))
def test_levels_are_as_symmetrical_as_their_tiles(seed, rows, columns, largest):
    image, defocus = draw(seed, 16 * rows, 16 * columns, largest)
    bokeh = scatter(image, defocus)
    for turn in (lambda a: a[::-1], lambda a: a[:, ::-1], lambda a: a.swapaxes(0, 1)):
        assert_allclose(scatter(turn(image), turn(defocus)), turn(bokeh), atol=1e-9)


@few
@given(seed=seeds, height=st.integers(1, 150), width=sides, largest=radii)
def test_any_number_of_threads_gives_the_same_bits(seed, height, width, largest):
    image, defocus = draw(seed, height, width, largest)
    before, results = numba.get_num_threads(), []
    for threads in (1, before):
        numba.set_num_threads(threads)
        results.append(scatter(image, defocus))
    numba.set_num_threads(before)
    assert_array_equal(*results)


@few
@given(smaller=st.floats(0, 70), growth=st.floats(0, 10), strength=st.floats(1e-3, 1e3))
def test_the_disc_of_a_light_grows_with_its_radius(smaller, growth, strength):
    """Every pixel lit by the smaller disc is lit by the larger one, and none twice as far away."""
    size = 2 * int(smaller + growth) + 9
    lit = []
    for radius in (smaller, smaller + growth):
        values = np.zeros((size, size, 4))
        values[size // 2, size // 2] = strength
        sums = scatter_forward(values, np.full((size, size), radius))[..., 0]
        y, x = np.mgrid[:size, :size] - size // 2
        lit.append(sums > 1e-9 * sums.max())
        assert not lit[-1][np.maximum(np.hypot(x, y) - 0.75, 0) > radius + 0.25].any()
    assert not (lit[0] & ~lit[1]).any()


@few
@given(seed=seeds, height=sides, width=sides, largest=radii)
def test_colours_stay_between_those_of_the_picture(seed, height, width, largest):
    image, defocus = draw(seed, height, width, largest)
    bokeh = scatter(image, defocus)
    assert bokeh.min() >= image.min() - 1e-9
    assert bokeh.max() <= image.max() + 1e-9


@few
@given(place=st.integers(0, 19), bad=st.sampled_from([np.nan, np.inf, -np.inf]))
def test_what_is_not_finite_is_rejected_at_the_door(place, bad):
    image, defocus = np.ones((4, 5, 3)), np.ones((4, 5))
    broken = defocus.copy()
    broken.flat[place] = bad
    with pytest.raises(ParameterError, match="defocus: expected finite values, got 1"):
        scatter(image, broken)
    broken = image.copy()
    broken.flat[place] = bad
    with pytest.raises(ParameterError, match="image: expected finite values, got 1"):
        scatter(broken, defocus)

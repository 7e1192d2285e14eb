"""Arrays written as ONNX nodes. Authority of all: the same in NumPy."""

import numpy as np
import pytest

onnx = pytest.importorskip("onnx", reason="needs onnx, of the extra train")
TensorProto, helper = onnx.TensorProto, onnx.helper

from bokehnet.onnx_file.builder import END, OPSET, Graph  # noqa: E402
from bokehnet.optics.encoding import decode, encode  # noqa: E402
from tests.unit.onnx_file.running import compiled, start  # noqa: E402

X = np.array([[-1.5, 2.0, 0.25], [4.0, -3.0, 1.0]], np.float32)


@pytest.mark.parametrize(
    "formula",
    [
        lambda x: 2 - x * 3 + x / 4,
        lambda x: 1 / (abs(x) + 1) ** 2,
        lambda x: -x + (x > 1).astype(np.float32) - (x <= 0.25).astype(np.float32),
        lambda x: (((x < 0) | (x >= 2)) & ~(x > 3)).astype(np.float32),
        lambda x: x.transpose(1, 0),
        lambda x: x.reshape(3, -1),
        lambda x: (abs(x).astype(np.int64) // 2 % 2).astype(np.float32),
        lambda x: x.clip(min=0) + x.clip(-1, 2) + x.clip(max=1),
        lambda x: encode(x) + decode(x),
    ],
)
def test_operators_mean_what_they_mean_in_numpy(formula):
    np.testing.assert_allclose(compiled(lambda g, v: formula(v), 2)(X), formula(X), rtol=1e-6)


@pytest.mark.parametrize("name", ["max", "min", "sum", "mean"])
def test_sums_go_along_axes(name):
    result = compiled(lambda g, v: getattr(v, name)(1), 2)(X)
    np.testing.assert_allclose(result, getattr(X, name)(1))


def test_without_axes_all_is_summed_to_one_number():
    result = compiled(lambda g, v: [v.max(), v.min(), v.sum(), (v > 3.5).any().astype(np.float32)], 2)(X)
    assert [x.shape for x in result] == [(1,)] * 4
    np.testing.assert_allclose(np.concatenate(result), [4, -3, X.sum(), 1])


def test_a_cut_may_have_steps_and_sizes_as_ends():
    build = lambda g, v: [v.cut(1, 1, END), v.cut(1, 0, END, 2), v.cut(0, v.size(0) - 1, 9)]  # noqa: E731
    result = compiled(build, 2)(X)
    for one, other in zip(result, [X[:, 1:], X[:, ::2], X[1:]], strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_loop_carries_arrays_that_grow_and_collects_one_from_each_turn():
    def build(g, v):
        def turn(number, x):
            return [g.concat([x, x])], [x.sum() * number.astype(np.float32)]

        return g.loop(turn, [v], times=g.constant([3], np.int64))

    grown, collected = compiled(build, 1)(np.float32([1, 2]))
    np.testing.assert_array_equal(grown, [1, 2] * 8)
    np.testing.assert_array_equal(collected[:, 0], [0, 6, 24])


def test_a_loop_runs_while_its_first_state_is_true():
    def build(g, v):
        def turn(_, __, x):
            doubled = x * 2
            return [doubled.max() < 100, doubled], []

        return g.loop(turn, [g.constant([True]), v], while_true=True)[1]

    assert compiled(build, 1)([3])[0] == 192


def test_a_loop_without_turns_gives_back_its_state():
    def build(g, v):
        return g.loop(lambda _, x: ([x + 1], []), [v], times=v.size(0) - 2)[0]

    np.testing.assert_array_equal(compiled(build, 1)([5, 6]), [5, 6])


def test_a_branch_works_out_one_side_only():
    def build(g, v):
        broken = lambda: v.reshape(7)  # no such shape: fails where it is worked out  # noqa: E731
        return g.branch(v.max() > 0, lambda: v * 2, broken)

    call = compiled(build, 1)
    np.testing.assert_array_equal(call([1, -1]), [2, -2])
    with pytest.raises(Exception, match="reshape"):
        call([-1, -1])


def test_another_file_can_be_the_input_of_the_metadata_or_of_both():
    """Its inputs are bound by name, one that it lacks is left out."""
    node = [helper.make_node("Mul", ["a", "two"], ["b"]), helper.make_node("Add", ["b", "two"], ["c"])]
    infos = [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n"]) for name in "ac"]
    two = helper.make_tensor("two", TensorProto.FLOAT, [1], [2.0])
    graph = helper.make_graph(node, "other", infos[:1], infos[1:], [two])
    other = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)])

    def build(g, v):
        once = g.inline(other, {"a": v, "unused": v})[0]
        return g.inline(other, {"a": once})[0]

    np.testing.assert_array_equal(compiled(build, 1)([1, 10]), [10, 46])


def test_a_constant_is_stored_once():
    g = Graph()
    value = g.input("x", np.float32, ["n"])
    model = g.model({"y": (value * 7 + 7 * value, ["n"])})
    onnx.checker.check_model(model, full_check=True)
    assert len(model.graph.initializer) == 1
    assert start(model).run(None, {"x": np.float32([2])})[0] == 28

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.arrays.resample import resample
from bokehnet.errors import ConfigError, ModelFileError, ParameterError
from bokehnet.inference.depth_convention import DepthConvention, convention_names, find_convention
from bokehnet.inference.monocular import DepthEstimator
from bokehnet.inference.point_maps import shift_of_points
from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear

onnx = pytest.importorskip("onnx", reason="makes networks with the extra train")
FLOAT, HALF = onnx.TensorProto.FLOAT, onnx.TensorProto.FLOAT16

PLAIN = DepthConvention(size=16, output="disparity")


def ramp(height=24, width=32):
    """A picture whose sRGB value rises evenly from left to right, scene-linear."""
    srgb = np.broadcast_to(((np.arange(width) + 0.5) / width)[:, None], (height, width, 3))
    return srgb_to_linear(srgb).astype(np.float32)


@pytest.fixture
def network(tmp_path):
    """A network that takes one channel of its input, times ``gain``; the shape of its input is free."""

    def write(shape=(1, 3, "h", "w"), kind=FLOAT, nodes=None, axis=1, channel=0, name="tiny.onnx", extra=()):
        helper = onnx.helper
        start = onnx.numpy_helper.from_array(np.array([channel], np.int64), "start")
        stop = onnx.numpy_helper.from_array(np.array([channel + 1], np.int64), "stop")
        axes = onnx.numpy_helper.from_array(np.array([axis], np.int64), "axes")
        nodes = nodes or [helper.make_node("Slice", ["image", "start", "stop", "axes"], ["depth"])]
        graph = helper.make_graph(
            nodes,
            "tiny",
            [helper.make_tensor_value_info("image", kind, shape), *extra],
            [helper.make_tensor_value_info("depth", kind, None)],
            [start, stop, axes],
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
        (tmp_path / name).write_bytes(model.SerializeToString())
        return tmp_path / name

    return write


def node(operator, *inputs, **attributes):
    return onnx.helper.make_node(operator, list(inputs), ["depth"], **attributes)


def test_the_names_that_come_with_the_package_can_be_read():
    metric = {"depth-anything-v2-metric", "depth-pro", "moge-2", "unidepth-v2"}
    relative = {"midas", "midas-dpt", "depth-anything-v2", "depth-anything-v2-apple", "marigold"}
    assert metric | relative == set(convention_names())
    for name in convention_names():
        assert (find_convention(name).unit == "m") == (name in metric)


@pytest.mark.parametrize(
    ("name", "size", "expected"),
    [
        # Depth Anything V2: the shorter side becomes 518, both are multiples of 14 (image2tensor).
        ("depth-anything-v2", (1080, 1920), (518, 924)),
        ("depth-anything-v2", (1000, 1000), (518, 518)),
        # MiDaS v2.1: the longer side becomes 384, both are multiples of 32 (default_transform).
        ("midas", (1080, 1920), (224, 384)),
        ("midas-dpt", (1080, 1920), (384, 672)),
    ],
)
def test_the_input_size_is_that_of_the_published_transforms(name, size, expected):
    assert find_convention(name).input_size(*size, (None, None)) == expected


def test_the_size_that_the_network_fixes_counts():
    convention = find_convention("midas")
    assert convention.input_size(1080, 1920, (256, 320)) == (256, 320)


@pytest.mark.parametrize("fit", ["shorter", "longer", "stretch"])
@pytest.mark.parametrize("size", [(1, 1), (1, 65000), (65000, 1), (3, 2)])
def test_no_shape_of_a_picture_makes_the_input_empty_or_huge(fit, size):
    convention = DepthConvention(size=518, multiple_of=14, fit=fit, output="disparity")
    height, width = convention.input_size(*size, (None, None))
    assert height % 14 == width % 14 == 0
    assert 14 <= min(height, width) <= max(height, width) <= 8192


def test_values_are_normalised_srgb_in_the_order_of_the_convention():
    colour = np.array([0.2, 0.5, 0.9])
    image = np.broadcast_to(srgb_to_linear(colour), (5, 7, 3)).astype(np.float32)
    mean, std = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
    expected = (colour - mean) / std
    rgb = DepthConvention(size=4, mean=mean, std=std, output="disparity").prepare(image, 4, 6)
    assert rgb.shape == (1, 3, 4, 6)
    assert rgb.dtype == np.float32
    assert_allclose(rgb, np.broadcast_to(expected[:, None, None], (1, 3, 4, 6)), rtol=1e-5, atol=1e-5)
    other = DepthConvention(
        size=4, channels="BGR", layout="NHWC", white=255.0, mean=(1.0, 2.0, 3.0), output="disparity"
    )
    bgr = (255 * colour - [1, 2, 3])[::-1]
    assert_allclose(other.prepare(image, 4, 6), np.broadcast_to(bgr, (1, 4, 6, 3)), rtol=1e-5)


def test_light_above_white_is_clipped():
    image = np.full((4, 4, 3), 50, np.float32)
    assert_allclose(PLAIN.prepare(image, 4, 4), 1)


@pytest.mark.parametrize("kernel", ["cubic", "linear", "area"])
def test_resampling_keeps_constants_and_the_mean_and_does_not_alias(kernel):
    """A grating of two pixels, made ten times smaller, is its mean: the sampling theorem."""
    grating = np.tile(np.array([0, 1], np.float32), (40, 40))
    assert_allclose(resample(grating, 4, 8, kernel)[:, 1:-1], 0.5, atol=0.02)
    assert_allclose(
        resample(np.full((5, 7, 3), 0.3, np.float32), 11, 3, kernel), np.full((11, 3, 3), 0.3), rtol=1e-6
    )
    step = np.repeat(np.array([[0, 1]], np.float32), 20, axis=1)
    larger = resample(step, 3, 200, kernel)
    assert larger.min() == 0
    assert larger.max() == 1


@pytest.mark.parametrize(
    ("shape", "axis", "layout", "kind"),
    [
        ((1, 3, "h", "w"), 1, "NCHW", FLOAT),
        ((1, 3, 14, 28), 1, "NCHW", FLOAT),
        (("n", "c", "h", "w"), 1, "NCHW", HALF),
        ((1, "h", "w", 3), 3, "NHWC", FLOAT),
    ],
)
def test_the_map_comes_back_at_the_size_of_the_picture(network, shape, axis, layout, kind):
    """The network returns its input, so the map is the sRGB ramp, brought to 0..1."""
    convention = DepthConvention(size=16, layout=layout, output="disparity")
    estimator = DepthEstimator(network(shape, kind, axis=axis), convention, threads=1)
    disparity = estimator(ramp())
    assert disparity.shape == (24, 32)
    assert disparity.dtype == np.float32
    assert not estimator.metric
    assert (disparity.min(), disparity.max()) == (0, 1)
    assert_allclose(disparity, np.broadcast_to(np.linspace(0, 1, 32), (24, 32)), atol=0.06)


def test_depth_in_metres_becomes_inverse_millimetres(network):
    convention = DepthConvention(size=16, white=10.0, output="depth", unit="m")  # depth is 10 times sRGB
    estimator = DepthEstimator(network(), convention, threads=1)
    image = np.full((24, 32, 3), srgb_to_linear(np.float64(0.4)), np.float32)
    assert estimator.metric
    assert_allclose(estimator(image), np.full((24, 32), 1 / 4000), rtol=1e-5)


def test_relative_depth_is_turned_over(network):
    estimator = DepthEstimator(network(), DepthConvention(size=16, output="depth"), threads=1)
    disparity = estimator(ramp())
    assert disparity[0, 0] == 1
    assert disparity[0, -1] == 0


def test_a_flat_picture_gives_a_flat_map(network):
    estimator = DepthEstimator(network(), PLAIN, threads=1)
    assert_allclose(estimator(np.full((5, 6, 3), 0.5)), np.zeros((5, 6)))


def test_a_picture_with_nan_is_refused(network):
    image = ramp()
    image[0, 0] = np.nan
    with pytest.raises(ParameterError, match="image"):
        DepthEstimator(network(), PLAIN, threads=1)(image)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"shape": (3, "h", "w")}, "expected a picture NCHW of floats"),
        ({"shape": (1, 4, "h", "w")}, "3 channels"),
        ({"shape": (2, 3, "h", "w")}, "3 channels"),
        ({"shape": (1, "h", "w", 3)}, "NCHW of a sensible size"),
        ({"shape": (1, 3, 100000, 100000)}, "sensible size"),
        ({"kind": onnx.TensorProto.DOUBLE}, "floats"),
        (
            {"extra": [onnx.helper.make_tensor_value_info("mask", FLOAT, (1,))]},
            "expected one input, a picture, found 2: image, mask",
        ),
        ({"nodes": [node("ReduceMean", "image")]}, "expected one map"),
        ({"nodes": [node("Identity", "image")]}, "expected one map"),
        ({"nodes": [node("Shape", "image")]}, "ONNX|one map"),
    ],
    ids=lambda value: None if isinstance(value, str) else "-".join(value),
)
def test_an_unsuitable_network_is_reported_by_its_name(network, options, words):
    with pytest.raises(ModelFileError, match=words) as caught:
        DepthEstimator(network(**options), PLAIN, threads=1)(ramp())
    assert "tiny.onnx" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_non_finite_output_is_reported(network):
    nodes = [
        onnx.helper.make_node("Slice", ["image", "start", "stop", "axes"], ["part"]),
        onnx.helper.make_node("Log", ["part"], ["depth"]),
    ]
    black = np.zeros((8, 8, 3), np.float32)
    with pytest.raises(ModelFileError, match="256 of 256 values of its output are NaN or infinite"):
        DepthEstimator(network(nodes=nodes), PLAIN, threads=1)(black)


def test_depth_not_above_zero_is_reported(network):
    convention = DepthConvention(size=16, mean=(0.5, 0.5, 0.5), output="depth", unit="m")
    with pytest.raises(ModelFileError, match="depth above 0"):
        DepthEstimator(network(), convention, threads=1)(ramp())


@pytest.mark.parametrize("content", [b"", b"hello", bytes(1000), b"\x08\x09" + b"\xff" * 50])
def test_a_file_that_is_not_onnx_is_reported(tmp_path, content):
    (tmp_path / "a.onnx").write_bytes(content)
    with pytest.raises(ModelFileError, match=r"a\.onnx: "):
        DepthEstimator(tmp_path / "a.onnx", PLAIN, threads=1)


def test_any_truncated_network_is_reported_or_works(network):
    path = network()
    whole = path.read_bytes()
    for length in range(0, len(whole), 17):
        path.write_bytes(whole[:length])
        with pytest.raises(ModelFileError):
            DepthEstimator(path, PLAIN, threads=1)(ramp())


@pytest.mark.parametrize("name", ["missing.onnx", "."])
def test_a_missing_network_is_reported(tmp_path, name):
    with pytest.raises(ModelFileError, match="expected an ONNX file"):
        DepthEstimator(tmp_path / name, PLAIN, threads=1)


def weights_elsewhere(path, location):
    """A network that adds a number which stands in another file."""
    weight = onnx.TensorProto(name="weight", data_type=FLOAT, dims=[1], data_location=1)
    for key, value in (("location", location), ("length", "4")):
        weight.external_data.add(key=key, value=value)
    nodes = [
        onnx.helper.make_node("ReduceMean", ["image"], ["grey"], axes=[1]),
        onnx.helper.make_node("Add", ["grey", "weight"], ["depth"]),
    ]
    graph = onnx.helper.make_graph(
        nodes,
        "outside",
        [onnx.helper.make_tensor_value_info("image", FLOAT, (1, 3, "h", "w"))],
        [onnx.helper.make_tensor_value_info("depth", FLOAT, None)],
        [weight],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9)
    path.write_bytes(model.SerializeToString())


def test_weights_in_a_file_next_to_the_network_are_read(tmp_path):
    (tmp_path / "weights.bin").write_bytes(np.float32(1).tobytes())
    weights_elsewhere(tmp_path / "a.onnx", "weights.bin")
    DepthEstimator(tmp_path / "a.onnx", PLAIN, threads=1)(ramp())


@pytest.mark.parametrize("kind", ["above", "absolute", "link", "missing"])
def test_files_outside_the_folder_of_the_network_are_not_read(tmp_path, kind):
    folder, secret = tmp_path / "models", tmp_path / "secret.bin"
    folder.mkdir()
    secret.write_bytes(np.float32(1).tobytes())
    (folder / "link.bin").symlink_to(secret)
    location = {"above": "../secret.bin", "absolute": str(secret), "link": "link.bin", "missing": "no.bin"}
    weights_elsewhere(folder / "a.onnx", location[kind])
    with pytest.raises(ModelFileError, match=r"a\.onnx: not a usable ONNX file"):
        DepthEstimator(folder / "a.onnx", PLAIN, threads=1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("size = 10", "missing key 'output'"),
        ('size = 10\noutput = "nearness"', "output"),
        ('size = 10\noutput = "depth"\nmeen = 1', "unknown key 'meen'"),
        ('size = 0\noutput = "depth"', "size: expected 1 to"),
        ('size = 100000\noutput = "depth"', "size: expected 1 to"),
        ('size = 10\nmultiple_of = 0\noutput = "depth"', "multiple_of"),
        ('size = 10\nstd = [1.0, 0.0, 1.0]\noutput = "depth"', "std not 0"),
        ('size = 10\nmean = [1.0, nan, 1.0]\noutput = "depth"', "finite"),
        ("size = [", "TOML"),
    ],
)
def test_a_wrong_convention_is_reported_by_key(tmp_path, text, words):
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ConfigError, match=words) as caught:
        find_convention(tmp_path / "mine.toml")
    assert "mine.toml" in str(caught.value)


def test_an_unknown_convention_lists_the_known_ones():
    with pytest.raises(ConfigError, match="midas-dpt"):
        find_convention("midass")


def test_the_ramp_has_its_stated_values():
    assert_allclose(linear_to_srgb(ramp())[0, :, 0], (np.arange(32) + 0.5) / 32, atol=1e-6)


def pinhole(shift=0.0, height=40, width=56):
    """Points of a slope and a step seen by a pinhole camera, (1, h, w, 3), metres; and their depth."""
    focal = 47.0  # pixels
    v, u = np.mgrid[:height, :width] - np.array([(height - 1) / 2, (width - 1) / 2])[:, None, None]
    depth = 2 + 0.03 * u + 1.5 * (v > 3)
    points = np.stack([u * depth / focal, v * depth / focal, depth + shift], -1)
    return points[None].astype(np.float32), depth


@pytest.mark.parametrize("shift", [-1.2, 0.0, 0.7, 30.0])
def test_the_shift_of_points_is_that_which_puts_them_on_rays(shift):
    """By construction: points of a pinhole camera, moved along its axis."""
    points, _ = pinhole(shift)
    assert_allclose(shift_of_points(points[0].transpose(2, 0, 1)), -shift, atol=2e-3)


@pytest.fixture
def points_network(tmp_path):
    """A network as MoGe-2's: a picture and num_tokens in, fixed points, scale and mask out."""

    def write(points, mask, scale=2.5):
        helper = onnx.helper
        stored = {"p": points, "m": mask.astype(np.float32)[None], "s": np.array([scale], np.float32)}
        nodes = [
            helper.make_node("ReduceMean", ["image"], ["mean"], keepdims=0),
            helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
            helper.make_node("Cast", ["num_tokens"], ["tokens"], to=FLOAT),
            helper.make_node("Div", ["tokens", "wanted"], ["one"]),  # 1 only with this convention
            helper.make_node("Add", ["p", "nothing"], ["points"]),
            helper.make_node("Identity", ["m"], ["mask"]),
            helper.make_node("Mul", ["s", "one"], ["metric_scale"]),
        ]
        constants = {**stored, "zero": np.zeros((), np.float32), "wanted": np.array(1800, np.float32)}
        graph = helper.make_graph(
            nodes,
            "points",
            [
                helper.make_tensor_value_info("image", FLOAT, (1, 3, "h", "w")),
                helper.make_tensor_value_info("num_tokens", onnx.TensorProto.INT64, ()),
            ],
            [helper.make_tensor_value_info(name, FLOAT, None) for name in ("mask", "points", "metric_scale")],
            [onnx.numpy_helper.from_array(value, name) for name, value in constants.items()],
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
        (tmp_path / "points.onnx").write_bytes(model.SerializeToString())
        return tmp_path / "points.onnx"

    return write


def test_a_map_of_points_becomes_disparity_in_metres_and_no_surface_is_infinitely_far(points_network):
    points, depth = pinhole(shift=0.4)
    sky = np.zeros(depth.shape, bool)
    sky[:5] = True
    points[0, :5] = 0.9  # what a network says of sky means nothing
    estimator = DepthEstimator(points_network(points, ~sky), find_convention("moge-2"))
    assert estimator.metric
    result = estimator(ramp(*depth.shape))
    assert_allclose(result[sky], 0, atol=0)
    assert_allclose(result[~sky], (1 / (2500 * depth))[~sky], rtol=2e-3)


def test_a_convention_that_names_another_output_is_refused(network, points_network):
    points, depth = pinhole()
    path = points_network(points, depth > 0)
    with pytest.raises(ModelFileError, match="expected an output predicted_depth, found mask, points"):
        DepthEstimator(path, DepthConvention(size=16, output="depth", map="predicted_depth", tokens=1800))
    with pytest.raises(ModelFileError, match="expected an output points, found depth"):
        DepthEstimator(network(), find_convention("moge-2"))


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ('output = "depth"\nshift = "unknown"\n', "shift: expected component with it"),
        ('output = "disparity"\nmask = "m"\n', "mask: expected depth as output"),
    ],
)
def test_fields_of_points_that_do_not_fit_are_reported(tmp_path, lines, words):
    (tmp_path / "mine.toml").write_text(f"size = 16\n{lines}")
    with pytest.raises(ConfigError, match=words):
        find_convention(tmp_path / "mine.toml")

"""The scatter in torch operations, on CPU and CUDA, against the authorities that the numba kernels have."""

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical import scatter_renderer as numpy_side
from bokehnet.classical.scatter import aperture_scatter, disc_scatter, pyramid_levels
from bokehnet.classical.scatter.aperture_table import LARGEST_TABLE
from bokehnet.classical.scatter.cats_eye import View, make_view
from bokehnet.classical.scatter.disc_scatter import BLOCK_ROWS, LARGEST_RADIUS
from bokehnet.classical.scatter.operators import scatter_operator
from bokehnet.classical.scatter.oracle import disc_weights, scatter_reference
from bokehnet.classical.torch import scanline_spans
from bokehnet.classical.torch.autograd import scatter
from bokehnet.classical.torch.pyramid_levels import scatter_sums as scatter_levels
from bokehnet.classical.torch.span_scatter import scatter_level
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture

no_cuda = pytest.mark.skipif(
    not torch.cuda.is_available(), reason="needs a CUDA device, torch finds none here"
)
DEVICES = ["cpu", pytest.param("cuda", marks=[pytest.mark.gpu, no_cuda])]
pytestmark = pytest.mark.parametrize("device", DEVICES)

SHAPES = {
    "disc": Aperture(),
    "blades": Aperture(blades=6, rotation=10),
    "curved, narrow": Aperture(blades=5, curvature=0.5, squeeze=0.6),
    "rim": Aperture(spherical_profile=0.7),
    "hole": Aperture(obstruction=0.4),
    "picture": Aperture(picture=np.random.default_rng(9).random((9, 7))),
    "cat's-eye": Aperture(cats_eye=0.8),
    "blades, cat's-eye": Aperture(blades=7, cats_eye=1.3),
}


def scene(height: int, width: int, largest: float, dtype: type = np.float64) -> tuple[np.ndarray, np.ndarray]:
    """Noise with a highlight and a channel of ones, (H, W, 4), and a smooth defocus with a jump."""
    values = np.random.default_rng(0).random((height, width, 4))
    values[height // 3, width // 3] = 1000
    values[..., 3] = 1
    y, x = np.mgrid[:height, :width] / max(height, width)
    defocus = largest * np.sin(5 * x + 1) * np.cos(4 * y)
    defocus[height // 2 :, : width // 4] = -0.9 * largest
    return values.astype(dtype), defocus.astype(dtype)


def tensors(device: str, *arrays: np.ndarray) -> list[torch.Tensor]:
    return [torch.from_numpy(array).to(device).requires_grad_() for array in arrays]


def array(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().cpu().numpy()


def point(device: str, size: int, radius: float, value: float = 1.0) -> np.ndarray:
    """Return the blur of one bright pixel in the middle."""
    values, defocus = torch.zeros(size, size, 1), torch.full((size, size), radius)
    values[size // 2, size // 2] = value
    return array(scatter_level(values.to(device), defocus.to(device)))[..., 0]


@pytest.mark.parametrize("shape", [(17, 23), (40, 9), (1, 12), (12, 1), (1, 1), (70, 33)])
def test_quotient_of_the_sums_equals_the_slow_oracle(device, shape):
    rng = np.random.default_rng(0)
    image, defocus = rng.random((*shape, 3)), rng.uniform(-7, 7, shape)
    values = np.concatenate([image, np.ones((*shape, 1))], axis=2)
    sums = array(scatter_level(*tensors(device, values, defocus)))
    assert_allclose(sums[..., :3] / sums[..., 3:], scatter_reference(image, defocus), atol=1e-4)


@pytest.mark.parametrize("radius", [0.3, 0.5, 0.7, 1.3, 2.6, 8.3, 63.9, 64.1])
def test_one_point_becomes_the_disc(device, radius):
    """Authority: lengths of thin lines inside the disc. Less than a thousandth of the light is elsewhere."""
    reach = math.ceil(radius) + 1
    weights = disc_weights(radius, reach) if radius > 0.5 else np.pad([[1.0]], reach)
    result = point(device, 2 * reach + 1, radius)
    assert np.abs(result - weights).sum() / 2 < 1e-3
    assert result.sum(dtype=float) == pytest.approx(1, abs=1e-6)


def compare_all(result, target, rtols: tuple[float, ...]) -> None:
    """Compare, channel by channel, to a part of the largest number."""
    for tensor, expected, rtol in zip(result, target, rtols, strict=True):
        largest = np.abs(expected).max(axis=(0, 1))
        assert tensor.dtype == torch.from_numpy(expected).dtype
        assert np.all(np.abs(array(tensor) - expected) <= rtol * np.maximum(largest, 1e-30))


@pytest.mark.parametrize(("dtype", "rtol"), [(np.float64, 1e-11), (np.float32, 1e-5)])
@pytest.mark.parametrize("largest", [5.0, 40.0, 63.9, 0.4])
def test_one_level_and_its_adjoint_equal_the_numba_kernels(device, largest, dtype, rtol):
    values, defocus = scene(BLOCK_ROWS + 9, 90, largest, dtype)
    gradient = np.random.default_rng(1).normal(size=values.shape).astype(dtype)
    inputs = tensors(device, values, defocus)
    sums = scatter_level(*inputs)
    sums.backward(torch.from_numpy(gradient).to(device))
    expected = (
        disc_scatter.scatter_forward(values, defocus),
        *disc_scatter.scatter_backward(values, defocus, gradient),
    )
    compare_all((sums, inputs[0].grad, inputs[1].grad), expected, (rtol, rtol, rtol))


@pytest.mark.parametrize("radius", [64.0, 70.3, 128.1, 299.7])
def test_discs_beyond_the_ladder_are_nearly_exact(device, radius):
    """Authority: the numba kernels, which compute each of them. All of the light is kept."""
    size = 2 * math.ceil(radius) + 3
    values, defocus = np.zeros((size, size, 1)), np.full((size, size), radius)
    values[size // 2, size // 2] = 1
    result, expected = (
        array(scatter_level(*tensors(device, values, defocus))),
        disc_scatter.scatter_forward(values, defocus),
    )
    assert np.abs(result - expected).sum() / 2 < 2e-4
    assert result.sum() == pytest.approx(1, abs=1e-10)


def compare_to_the_numba_levels(
    device: str, name: str, values: np.ndarray, defocus: np.ndarray, rtols: tuple[float, ...]
) -> None:
    """Compare the sums of all levels and their gradients.

    With a cat's-eye the numba kernels keep the light of a source to half a percent, for they look its share
    up in a table; here it is kept exactly. What it adds to the derivative by the defocus is left to the
    finite differences.
    """
    aperture, operator = SHAPES[name], scatter_operator(SHAPES[name])
    gradient = np.random.default_rng(1).normal(size=values.shape).astype(values.dtype)
    inputs = tensors(device, values, defocus)
    sums = scatter_levels(*inputs, aperture)
    sums.backward(torch.from_numpy(gradient).to(device))
    expected = pyramid_levels.scatter_forward(values, defocus, operator)
    gradients = pyramid_levels.scatter_backward(values, defocus, gradient, operator)
    if aperture.cats_eye:
        compare_all((sums, inputs[0].grad), (expected, gradients[0]), (1e-2, 1e-2))
    else:
        compare_all((sums, inputs[0].grad, inputs[1].grad), (expected, *gradients), rtols)


@pytest.mark.parametrize(("dtype", "rtol"), [(np.float64, 1e-9), (np.float32, 3e-5)])
@pytest.mark.parametrize("name", SHAPES)
def test_all_levels_and_their_adjoint_equal_the_numba_kernels(device, name, dtype, rtol):
    """Sizes are odd and the radii lie on both sides of every threshold."""
    compare_to_the_numba_levels(device, name, *scene(BLOCK_ROWS + 5, 101, 30.0, dtype), (rtol, rtol, rtol))


@pytest.mark.parametrize(
    ("name", "rtols"),
    [("disc", (1e-5, 1e-5, 2e-3)), ("blades", (1e-9, 1e-9, 1e-9)), ("cat's-eye", (1e-9, 1e-9, 1e-9))],
)
def test_shapes_beyond_the_ladder_equal_the_numba_kernels(device, name, rtols):
    """Random signs, so that nothing is merged: each source keeps its own radius."""
    rng = np.random.default_rng(2)
    defocus = rng.uniform(0.9, 2.2, (21, 26)) * LARGEST_TABLE * rng.choice([-1, 1], (21, 26))
    compare_to_the_numba_levels(device, name, rng.random((21, 26, 4)), defocus, rtols)


@pytest.mark.parametrize(("radius", "rtol"), [(1.2, 1e-6), (-3.7, 1e-5), (9.1, 1e-4), (-25.0, 1e-4)])
@pytest.mark.parametrize("place", [(45, 60), (30, 90), (70, 30)])
def test_one_point_becomes_the_clipped_shape(device, place, radius, rtol):
    """Equal to the numba kernels' but for the share by which they divide: their own sum is divided out.

    They take a polynomial for the circle's area, which is within 3e-8 of it; times the square of the
    radius, that moves the ends of a row by up to 2e-5 pixels.
    """
    aperture = Aperture(blades=6, cats_eye=1.2)
    values, defocus = np.zeros((100, 130, 1)), np.full((100, 130), radius)
    values[place] = 1
    view = make_view(1.2, defocus.shape, 1.0)
    result = array(scatter_level(*tensors(device, values, defocus), aperture, view))
    expected = aperture_scatter.scatter_forward(values, defocus, aperture)
    assert result.sum() == pytest.approx(1, abs=1e-9)
    assert_allclose(result, expected / expected.sum(), atol=rtol * result.max())


def test_shape_that_the_second_pupil_would_hide_stays_whole(device):
    """A lit spot on the opening's left, in front of focus at the left border: nothing would pass."""
    picture = np.zeros((64, 64))
    picture[30:34, :4] = 1
    values, defocus = np.zeros((9, 60, 1)), np.full((9, 60), 6.0)
    values[4, 2] = values[4, 40] = 1
    inputs = tensors(device, values, defocus)
    clipped = Aperture(picture=picture, cats_eye=1.5)
    result = array(scatter_level(*inputs, clipped, make_view(1.5, defocus.shape, 1.0)))
    whole = array(scatter_level(*inputs, Aperture(picture=picture)))
    assert_allclose(result, whole, atol=1e-12)
    assert result.sum() == pytest.approx(2, abs=1e-9)


@pytest.mark.parametrize("name", ["disc", "blades", "rim", "cat's-eye"])
@pytest.mark.parametrize(("height", "width", "largest"), [(5, 6, 2.5), (7, 4, 6.0), (1, 9, 3.0)])
def test_gradients_of_one_level_match_finite_differences(device, name, height, width, largest):
    generator = torch.Generator().manual_seed(0)
    values = torch.rand(height, width, 2, dtype=torch.float64, generator=generator).to(device)
    signs = 2 * torch.randint(0, 2, (height, width), generator=generator) - 1
    defocus = (
        0.7 + (largest - 0.7) * torch.rand(height, width, dtype=torch.float64, generator=generator)
    ) * signs
    aperture = None if name == "disc" else SHAPES[name]
    view = View(0.8, -0.4, -0.3, 0.1, 0.05) if name == "cat's-eye" else None

    def run(values: torch.Tensor, defocus: torch.Tensor) -> torch.Tensor:
        return scatter_level(values, defocus, aperture, view)

    assert torch.autograd.gradcheck(run, (values.requires_grad_(), defocus.to(device).requires_grad_()))


def test_gradients_of_merged_sources_match_finite_differences(device):
    """A plane whose blocks are merged twice; far from every threshold, so that the choice stays the same."""
    generator = torch.Generator().manual_seed(0)
    values = (1 + torch.rand(6, 7, 2, dtype=torch.float64, generator=generator)).to(device)
    defocus = 60 + torch.rand(6, 7, dtype=torch.float64, generator=generator).to(device)
    assert torch.autograd.gradcheck(scatter_levels, (values.requires_grad_(), defocus.requires_grad_()))


def test_nothing_is_left_beyond_a_bright_disc(device):
    """Light 10^6 times brighter than the rest: beyond the disc not a bit of it, and black stays black."""
    result = point(device, 101, 20.3, 1e6)
    y, x = np.mgrid[:101, :101] - 50
    assert_array_equal(result[np.hypot(x, y) > 22], 0)
    assert result.min() == 0
    values, defocus = torch.full((1, 2000, 1), 1e-3), torch.full((1, 2000), 3.0)
    plain = scatter_level(values.to(device), defocus.to(device))
    values[0, 20] = 1e3
    assert_allclose(
        array(scatter_level(values.to(device), defocus.to(device)))[0, 24:], array(plain)[0, 24:], rtol=1e-5
    )


def test_dim_and_bright_channels_keep_their_digits(device):
    """Each channel has a scale of its own, from the smallest to the largest float32."""
    values, defocus = scene(30, 40, 6.0)
    scales = np.array([1e-35, 1e35, 1.0, 1.0])
    plain = array(scatter_level(*tensors(device, values, defocus)))
    scaled = array(
        scatter_level(*tensors(device, (values * scales).astype(np.float32), defocus.astype(np.float32)))
    )
    assert_allclose(scaled / scales, plain, rtol=1e-4)


@pytest.mark.parametrize("name", ["disc", "blades"])
def test_size_of_the_batches_does_not_matter(device, name, monkeypatch):
    """Whole numbers may be added in any order: the same bits, also where one source fills a batch."""
    values, defocus = scene(31, 40, 30.0, np.float32)
    results = []
    for at_once in (1 << 21, 1000, 20):
        monkeypatch.setattr(scanline_spans, "_SPANS_PER_BATCH", at_once)
        inputs = tensors(device, values, defocus)
        sums = scatter_levels(*inputs, SHAPES[name])
        sums.square().sum().backward()
        results.append([array(tensor) for tensor in (sums, inputs[0].grad, inputs[1].grad)])
    for result in results[1:]:
        for actual, expected in zip(result, results[0], strict=True):
            assert_array_equal(actual, expected)


def test_sharp_pixels_keep_their_value_and_their_gradient(device):
    values, _ = scene(12, 15, 1.0, np.float32)
    inputs = tensors(device, values, np.full((12, 15), -0.5, np.float32))
    sums = scatter_levels(*inputs)
    sums.backward(2 * torch.ones_like(sums))
    assert_array_equal(array(sums), values)
    assert_array_equal(array(inputs[0].grad), 2)
    assert_array_equal(array(inputs[1].grad), 0)


def test_largest_radii_spread_evenly_over_everything(device):
    inputs = tensors(device, np.ones((6, 8, 1)), np.full((6, 8), 2 * LARGEST_RADIUS))
    sums = scatter_level(*inputs)
    sums.sum().backward()
    assert_allclose(array(sums), 48 / (math.pi * LARGEST_RADIUS**2), rtol=1e-5)
    assert_array_equal(array(inputs[1].grad), 0)


def test_pixels_without_light_still_get_their_gradient(device):
    """The sums are linear in the values: the derivative by a value does not depend on it.

    The gradient for the sums comes with its channels in front, as a network's would.
    """
    values, defocus = scene(12, 15, 6.0)
    gradient = np.random.default_rng(1).normal(size=values.shape)
    inputs = tensors(device, np.zeros_like(values), defocus)
    channels_first = torch.from_numpy(np.moveaxis(gradient, 2, 0).copy()).to(device)
    (scatter_level(*inputs).movedim(2, 0).contiguous() * channels_first).sum().backward()
    expected = disc_scatter.scatter_backward(values, defocus, gradient)[0]
    assert_allclose(array(inputs[0].grad), expected, atol=1e-12)


def test_a_channel_with_nan_is_nan_and_the_others_are_not(device):
    values, defocus = scene(9, 11, 3.0)
    values[4, 5, 1] = np.nan
    sums = array(scatter_level(*tensors(device, values, defocus)))
    assert np.isnan(sums[..., 1]).all()
    assert np.isfinite(sums[..., [0, 2, 3]]).all()


@pytest.mark.parametrize("name", ["disc", "blades"])
def test_torch_door_renders_where_its_tensors_are(device, name):
    rng = np.random.default_rng(3)
    image, (_, defocus) = rng.random((40, 50, 3), dtype=np.float32), scene(40, 50, 20.0, np.float32)
    bokeh = scatter(*tensors(device, image, defocus), SHAPES[name])
    assert bokeh.device.type == device
    assert_allclose(array(bokeh), numpy_side.scatter(image, defocus, SHAPES[name]), atol=2e-6)


def test_other_dtypes_are_rejected_at_the_door(device):
    values, defocus = torch.ones(4, 5, 1, device=device), torch.ones(4, 5, device=device)
    with pytest.raises(
        ParameterError, match=r"got torch.float16 and torch.float16; convert them with .float\(\)"
    ):
        scatter_levels(values.half(), defocus.half())
    with pytest.raises(ParameterError, match="image: expected float32 or float64"):
        scatter(values.half(), defocus.half())
    with pytest.raises(ParameterError, match=r"got torch.float32 and torch.float64"):
        scatter_levels(values, defocus.double())

"""Authorities: finite differences, the numba rays, the over operator in focus."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the extra torch")

from bokehnet.classical.layered.layers import Layers  # noqa: E402
from bokehnet.classical.rays_renderer import rays  # noqa: E402
from bokehnet.errors import ParameterError, ShapeError  # noqa: E402
from bokehnet.optics.aperture import Aperture  # noqa: E402
from bokehnet.torch import BokehBlur, SmoothAperture, layered, split_layers  # noqa: E402

NUMBERS = {"curvature": 0.3, "rotation": 11.0, "squeeze": 1.2, "cats_eye": 0.4}


def small_scene(height: int = 6, width: int = 7) -> list:
    """Return picture, defocus, hidden picture, hidden defocus and coverage: a patch before a tilted wall."""
    generator = torch.Generator().manual_seed(0)

    def random(channels: int) -> torch.Tensor:
        return torch.rand(1, channels, height, width, dtype=torch.float64, generator=generator)

    defocus, coverage = 0.05 * random(1) - 2.3, torch.ones(1, 1, height, width, dtype=torch.float64)
    defocus[..., 2:4, 2:5] += 5.1
    coverage[..., 2:4, 2:5] = 0.7
    tensors = [random(2), defocus, random(2), torch.full_like(defocus, -2.4), coverage]
    return [tensor.requires_grad_() for tensor in tensors]


def test_gradients_of_all_inputs_match_finite_differences():
    numbers = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in NUMBERS.values()]

    def render(image, defocus, hidden, behind, coverage, *values):
        aperture = SmoothAperture(blades=5, softness=0.2, **dict(zip(NUMBERS, values, strict=True)))
        return layered(image, defocus, [(hidden, behind)], coverage, aperture, samples=2)

    inputs = (*small_scene(), *numbers)
    assert torch.autograd.gradcheck(render, inputs, eps=1e-7, atol=1e-5, fast_mode=True)


def test_gradients_of_blur_and_focus_match_finite_differences():
    blur = BokehBlur(blur=6.0, focus=0.37, samples=2).double()
    disparity = torch.rand(1, 1, 5, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    disparity = 0.1 * disparity
    disparity[..., 2:, 3:] += 0.6
    image = torch.rand(1, 3, 5, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(2))

    def render(*numbers):
        return torch.func.functional_call(
            blur, dict(zip(("blur", "focus"), numbers, strict=True)), (image, disparity)
        )

    assert torch.autograd.gradcheck(render, (blur.blur, blur.focus), eps=1e-7, atol=1e-5)


def layered_scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return colours, defocus and coverage of two layers: textured bars before a textured slope."""
    rng = np.random.default_rng(0)
    texture = rng.random((2, 24, 32, 3), np.float32).repeat(4, 1).repeat(4, 2)
    colors = np.ascontiguousarray(texture.transpose(1, 2, 0, 3))
    slope = -6 + 4 * np.mgrid[:96, :128][0].astype(np.float32) / 96
    bars = np.mgrid[:96, :128][1] % 32 < 9
    colors[..., 0, :][~bars] = colors[..., 1, :][~bars]
    defocus = np.stack([np.where(bars, np.float32(7), slope), slope], -1)
    coverage = np.ones_like(defocus)
    return colors, defocus, coverage


@pytest.mark.parametrize("aperture", [Aperture(), Aperture(blades=6, rotation=10.0, cats_eye=0.6)])
def test_equals_the_numba_rays_with_the_same_layers(aperture):
    colors, defocus, coverage = layered_scene()
    stack = Layers(colors=colors, defocus=defocus, coverage=coverage)
    expected = rays(colors[:, :, 0], defocus[..., 0], aperture=aperture, layers=stack)
    picture, hidden = torch.from_numpy(colors).permute(2, 3, 0, 1)[:, None]
    front, behind = torch.from_numpy(defocus).permute(2, 0, 1)[:, None, None]
    bokeh = layered(picture, front, [(hidden, behind)], aperture=aperture, samples=64)
    error = bokeh[0].movedim(0, 2).numpy() - expected
    assert -10 * np.log10(np.square(error).mean()) > 40


def test_a_picture_in_focus_is_composited_by_its_coverage():
    picture, _, hidden, behind, coverage = (tensor.detach() for tensor in small_scene())
    bokeh = layered(picture, torch.zeros_like(behind), [(hidden, torch.full_like(behind, -1e-4))], coverage)
    torch.testing.assert_close(bokeh, coverage * picture + (1 - coverage) * hidden, atol=1e-3, rtol=0)


def test_batches_equal_single_pictures_and_vmap():
    generator = torch.Generator().manual_seed(3)
    image = torch.rand(2, 3, 9, 10, generator=generator)
    defocus = 4 * torch.rand(2, 1, 9, 10, generator=generator) - 2
    together = layered(image, defocus, samples=4)
    alone = torch.cat([layered(image[i : i + 1], defocus[i : i + 1], samples=4) for i in range(2)])
    torch.testing.assert_close(together, alone)
    mapped = torch.func.vmap(lambda x: layered(x[None], defocus[:1], samples=4)[0])(image)
    torch.testing.assert_close(mapped, layered(image, defocus[:1].repeat(2, 1, 1, 1), samples=4))


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_computed_in_float32(dtype):
    generator = torch.Generator().manual_seed(4)
    image = torch.rand(1, 3, 9, 10, generator=generator).to(dtype)
    defocus = (4 * torch.rand(1, 1, 9, 10, generator=generator) - 2).to(dtype)
    bokeh = layered(image, defocus, samples=4)
    assert bokeh.dtype == dtype
    torch.testing.assert_close(bokeh, layered(image.float(), defocus.float(), samples=4).to(dtype))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        torch.testing.assert_close(layered(image, defocus, samples=4), bokeh)


@pytest.mark.slow
def test_a_compiled_render_is_the_same():
    image, defocus = torch.rand(1, 3, 4, 5), torch.full((1, 1, 4, 5), 0.6)
    compiled = torch.compile(lambda *inputs: layered(*inputs, samples=1), backend="aot_eager")
    torch.testing.assert_close(compiled(image, defocus), layered(image, defocus, samples=1))


def test_split_layers_are_those_of_the_numba_estimate():
    colors, defocus, _ = layered_scene()
    image = torch.from_numpy(colors[:, :, 0]).movedim(2, 0)[None]
    first, radius, background, coverage = split_layers(
        image, torch.from_numpy(defocus[..., 0].copy())[None, None]
    )
    assert first.shape == image.shape
    assert coverage.min() >= 0
    hidden, behind = background[0]
    is_bar = radius > 5
    assert (behind[is_bar] < 0).float().mean() > 0.9
    assert hidden.shape == image.shape


@pytest.mark.parametrize(
    ("inputs", "error", "message"),
    [
        ((torch.rand(3, 4, 5), torch.rand(1, 1, 4, 5)), ShapeError, r"image: expected shape \(B, C, H, W\)"),
        ((torch.rand(1, 3, 4, 5), torch.rand(1, 1, 4, 6)), ShapeError, r"defocus: expected \(1, 1, 4, 5\)"),
        ((torch.ones(1, 3, 4, 5).int(), torch.rand(1, 1, 4, 5)), ParameterError, r"torch.int32; convert"),
        ((np.ones((1, 3, 4, 5)), torch.rand(1, 1, 4, 5)), ParameterError, "torch.from_numpy"),
        (
            (torch.rand(1, 3, 4, 5), torch.rand(1, 1, 4, 5).to("meta")),
            ParameterError,
            r"\.to\(image.device\)",
        ),
    ],
)
def test_bad_inputs_raise_one_line(inputs, error, message):
    with pytest.raises(error, match=message) as caught:
        layered(*inputs)
    assert "\n" not in str(caught.value)

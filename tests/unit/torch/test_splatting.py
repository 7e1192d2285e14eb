"""Authorities: finite differences, the exact scatter of numba, closed forms."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the extra torch")

from bokehnet.classical.scatter_renderer import scatter as numba_scatter  # noqa: E402
from bokehnet.classical.scatter_renderer import scatter_inside  # noqa: E402
from bokehnet.engines.engine import Engine  # noqa: E402
from bokehnet.optics.aperture import Aperture, transmission  # noqa: E402
from bokehnet.torch import SmoothAperture, scatter  # noqa: E402
from bokehnet.torch.aperture import pupil_samples  # noqa: E402

NUMBERS = {"curvature": 0.3, "rotation": 11.0, "squeeze": 1.2, "cats_eye": 0.4}


def test_gradients_match_finite_differences():
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(1, 2, 5, 6, dtype=torch.float64, generator=generator, requires_grad=True)
    defocus = (6 * torch.rand(1, 1, 5, 6, dtype=torch.float64, generator=generator) - 3).requires_grad_()
    numbers = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in NUMBERS.values()]

    def render(image, defocus, *values):
        aperture = SmoothAperture(blades=5, softness=0.2, **dict(zip(NUMBERS, values, strict=True)))
        return scatter(image, defocus, aperture, samples=3)

    assert torch.autograd.gradcheck(render, (image, defocus, *numbers), eps=1e-7, atol=1e-5, fast_mode=True)


@pytest.mark.parametrize("aperture", [None, Aperture(blades=6, rotation=10.0)])
def test_fixed_apertures_equal_the_numba_scatter(aperture):
    rng = np.random.default_rng(0)
    image, defocus = rng.random((9, 12, 3), np.float32), 3 * rng.random((9, 12), np.float32)
    bokeh = scatter(
        torch.from_numpy(image).movedim(2, 0)[None], torch.from_numpy(defocus)[None, None], aperture
    )
    np.testing.assert_allclose(
        bokeh[0].movedim(0, 2).numpy(), numba_scatter(image, defocus, aperture), atol=1e-6
    )


def test_smooth_disc_approaches_the_exact_disc():
    rng = np.random.default_rng(1)
    image = (
        torch.from_numpy(rng.random((1, 3, 12, 16), np.float32))
        .repeat_interleave(4, 2)
        .repeat_interleave(4, 3)
    )
    defocus = torch.full((1, 1, 48, 64), 6.0)
    error = scatter(image, defocus, SmoothAperture()) - scatter(image, defocus)
    assert -10 * float(error.square().mean().log10()) > 40


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("numbers", [{"blades": 6, "curvature": 0.4, "rotation": 20.0}, {"squeeze": 0.7}])
def test_smooth_weights_approach_the_transmission(numbers, side):
    pupil = pupil_samples(SmoothAperture(softness=0.02, **numbers), 128, torch.zeros(1))
    u, v = pupil.points.numpy()
    expected = transmission(Aperture(**numbers), u, v)
    assert np.abs(pupil.weights[side].numpy() - expected).mean() < 0.02


def test_vmap_equals_a_loop():
    image, defocus = torch.rand(3, 1, 2, 7, 8), torch.full((1, 1, 7, 8), 2.5)
    aperture = SmoothAperture(blades=5)
    mapped = torch.func.vmap(lambda x: scatter(x, defocus, aperture, samples=4))(image)
    torch.testing.assert_close(mapped, torch.stack([scatter(x, defocus, aperture, samples=4) for x in image]))


def test_a_lamp_at_the_border_has_the_light_of_the_engine():
    """Authority: the engine in NumPy, whose picture continues beyond its border."""
    rng = np.random.default_rng(3)
    image = rng.random((30, 41, 3), np.float32)
    image[:3, 10:13] = 40.0  # a lamp, whose border pixels are not repeated
    image[:, 0] = 5.0  # a line along a side
    defocus = np.full((30, 41), 6.4, np.float32)
    expected = Engine("scatter").render(image, defocus).bokeh
    tensors = torch.from_numpy(image).movedim(2, 0)[None], torch.from_numpy(defocus)[None, None]
    np.testing.assert_allclose(scatter(*tensors)[0].movedim(0, 2).numpy(), expected, rtol=2e-5, atol=2e-5)
    sampled = scatter(*tensors, SmoothAperture())[0].movedim(0, 2).numpy()
    inside = scatter_inside(image, defocus)
    assert np.abs(sampled - expected).mean() < 0.6 * np.abs(inside - expected).mean()

"""Gradients that are not finite name the operation and its input."""

import pytest

torch = pytest.importorskip("torch", reason="needs the extra torch")

from bokehnet.errors import ParameterError  # noqa: E402
from bokehnet.torch import BokehBlur, SmoothAperture, checked_gradients, layered, scatter  # noqa: E402


def scene() -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(1, 3, 9, 10, generator=generator)
    defocus = torch.full((1, 1, 9, 10), 2.0)
    defocus[..., 4:] = -1.5
    return image.requires_grad_(), defocus.requires_grad_()


def render(operation: str, image: torch.Tensor, defocus: torch.Tensor) -> torch.Tensor:
    if operation == "layered":
        return layered(image, defocus, samples=2)
    return scatter(image, defocus, SmoothAperture(blades=5) if operation == "smooth" else None, samples=2)


@pytest.mark.parametrize("operation", ["layered", "scatter", "smooth"])
def test_nan_in_the_picture_is_named_at_the_operation(operation):
    image, defocus = scene()
    with torch.no_grad():
        image[0, 1, 3, 3] = torch.nan
    with checked_gradients():
        bokeh = render(operation, image, defocus)
    name = "scatter" if operation == "smooth" else operation
    with pytest.raises(ParameterError, match=f"{name}: gradient of defocus: expected finite") as caught:
        bokeh.nan_to_num().sum().backward()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("operation", ["layered", "scatter"])
def test_nan_of_the_loss_is_named_at_the_result(operation):
    image, defocus = scene()
    with checked_gradients():
        bokeh = render(operation, image, defocus)
    with pytest.raises(ParameterError, match=f"{operation}: gradient of its result: .* check the loss"):
        (bokeh.mean() * torch.nan).backward()


def test_the_module_is_checked():
    image, defocus = scene()
    blur = BokehBlur(blur=1.0, samples=2)
    with checked_gradients():
        bokeh = blur(image.detach(), defocus.detach())
    with pytest.raises(ParameterError, match="layered: gradient of its result"):
        (bokeh.mean() * torch.inf).backward()


@pytest.mark.parametrize("operation", ["layered", "scatter"])
def test_finite_gradients_are_those_without_the_check(operation):
    image, defocus = scene()
    plain = torch.autograd.grad(render(operation, image, defocus).square().sum(), (image, defocus))
    with checked_gradients():
        bokeh = render(operation, image, defocus)
    checked = torch.autograd.grad(bokeh.square().sum(), (image, defocus))
    for a, b in zip(plain, checked, strict=True):
        torch.testing.assert_close(a, b)


def test_gradients_are_not_checked_by_default():
    image, defocus = scene()
    (render("layered", image, defocus).mean() * torch.nan).backward()
    assert image.grad is not None
    assert image.grad.isnan().any()

"""Check of gradients that names the operation and the input whose gradient is not finite."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import torch
from torch import Tensor

from bokehnet.errors import ParameterError

__all__ = ["checked_gradients", "watch_input", "watch_output"]

_enabled: ContextVar[bool] = ContextVar("checked_gradients", default=False)


@contextmanager
def checked_gradients() -> Iterator[None]:
    """Check the gradients of operations of this package that run inside the context.

    Their backward pass, also after the context, raises an error at the first gradient that is NaN or
    infinite; it names the operation and the input, or says that the gradient was so before the operation.
    Off by default, because scaled losses of mixed precision rely on silent infinities, and because it waits
    for the device. ``torch.autograd.set_detect_anomaly`` names operators of torch instead.

    Raises:
        ParameterError: In the backward pass.

    Examples:
        >>> with checked_gradients():
        ...     bokeh = layered(torch.rand(1, 3, 8, 8, requires_grad=True), torch.zeros(1, 1, 8, 8))
        >>> bokeh.sum().backward()
    """
    token = _enabled.set(True)
    try:
        yield
    finally:
        _enabled.reset(token)


def _watch(tensor: Tensor, operation: str, name: str, remedy: str) -> Tensor:
    if not (_enabled.get() and tensor.requires_grad):
        return tensor

    def check(gradient: Tensor) -> None:
        if (count := int((~torch.isfinite(gradient)).sum())) == 0:
            return
        shown = f"NaN or infinity in {count} of {gradient.numel()} elements"
        raise ParameterError(f"{operation}: gradient of {name}", "finite numbers", shown=shown, remedy=remedy)

    watched = tensor.view_as(tensor)  # has the gradient of this operation alone
    watched.register_hook(check)
    return watched


def watch_input(operation: str, name: str, tensor: Tensor) -> Tensor:
    """Return an input of an operation, whose gradient is checked inside :func:`checked_gradients`."""
    remedy = "check the inputs of this operation for NaN, infinity and extreme values"
    return _watch(tensor, operation, name, remedy)


def watch_output(operation: str, tensor: Tensor) -> Tensor:
    """Return the result of an operation; a gradient that arrives there not finite comes from later ones."""
    return _watch(tensor, operation, "its result", "check the loss and the operations after this one")

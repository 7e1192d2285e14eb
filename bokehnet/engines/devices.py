"""Device of an engine: the CPU, or a CUDA device."""

from importlib import import_module

from bokehnet.checks import check_choice, require_extra
from bokehnet.classical.base import ClassicalRenderer, make_classical
from bokehnet.engine_registry import CLASSICAL
from bokehnet.errors import MissingExtraError, ParameterError
from bokehnet.onnx_session import CPU, load_onnxruntime

__all__ = ["DEVICES", "device_of", "make_on", "providers_on"]

DEVICES = ("cpu", "cuda", "auto")

_PROVIDER = "CUDAExecutionProvider"


def device_of(device: str, classical: str) -> str:
    """Return ``cpu`` or ``cuda`` for the selected device.

    Args:
        device: One of ``DEVICES``; ``auto`` is the CUDA device if it is usable, else the CPU.
        classical: Name of the classical renderer; methods of the literature run on the CPU only.

    Raises:
        ParameterError: ``cuda`` without such a device, or not for this renderer.
        MissingExtraError: ``cuda`` without the packages that it needs.

    Examples:
        >>> device_of("cpu", "rays"), device_of("auto", "jimenez")
        ('cpu', 'cpu')
    """
    check_choice("device", device, DEVICES)
    if device == "cpu":
        return device
    reason: Exception | None = None
    if classical not in CLASSICAL:
        reason = _device_error(f"cpu for {classical}, which supports no other")
    else:
        try:
            require_extra("torch", "cuda")
            problem = import_module("bokehnet.classical.torch.device_scatter").cuda_unavailable_reason()
            if classical == "rays":
                problem = problem or _why_no_rays()
            if problem:
                reason = _device_error(f"a usable CUDA device; found {problem}")
        except MissingExtraError as error:
            reason = error
    if reason is None:
        return "cuda"
    if device == "auto":
        return "cpu"
    raise reason


def _why_no_rays() -> str | None:
    """Return the reason why numba can use no CUDA device, a failed import of ``numba.cuda`` included."""
    try:
        march = import_module("bokehnet.classical.cuda.march")
    except Exception as error:  # numba-cuda raises AttributeError beside a NumPy that it does not fit
        return f"numba.cuda that cannot be imported ({' '.join(str(error).split())})"
    reason: str | None = march.cuda_rays_unavailable_reason()
    return reason


def _device_error(expected: str) -> ParameterError:
    return ParameterError("engine.device", expected, "cuda", "use --device cpu, or auto, which selects it")


def make_on(device: str, classical: str) -> ClassicalRenderer:
    """Return a classical renderer that runs on ``cpu`` or ``cuda``."""
    if device == "cpu":
        return make_classical(classical)
    renderer: ClassicalRenderer = import_module("bokehnet.classical.cuda.renderers").make_on_cuda(classical)
    return renderer


def providers_on(device: str) -> tuple[str, ...]:
    """Return the execution providers of networks on a device: CUDA's if available, else the CPU's."""
    if device == "cuda" and _PROVIDER in load_onnxruntime().get_available_providers():
        return (_PROVIDER, *CPU)
    return CPU

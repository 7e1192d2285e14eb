"""Classical renderers on a CUDA device, by name."""

from functools import partial

from bokehnet.classical.base import ClassicalRenderer
from bokehnet.classical.cuda.march import CudaMarch
from bokehnet.classical.picture_job import Device
from bokehnet.classical.rays_renderer import render_rays
from bokehnet.classical.scatter_renderer import render_scatter
from bokehnet.classical.torch.device_scatter import scatter_on

__all__ = ["make_on_cuda"]


def make_on_cuda(classical: str) -> ClassicalRenderer:
    """Return the classical renderer ``rays`` or ``scatter`` on the CUDA device.

    The device traces the rays and scatters; the CPU computes layers, means over windows and bright lights.

    Args:
        classical: Name of the renderer.
    """
    if classical == "scatter":
        return partial(render_scatter, scattered=scatter_on("cuda"))
    return partial(render_rays, device=Device(scatter_on("cuda"), CudaMarch()))

"""Depth from defocus in miniature: read focus and blur off a bokeh picture by gradient descent.

Known are the all-in-focus picture, its disparity and a picture with bokeh, 8-bit as from a file. Unknown are
the blur K and the focus f of ``defocus = K * (disparity - f)``. The command, from the root of the
repository, which hides a pair of numbers and looks for it::

    python examples/depth_from_defocus.py --blur 12 --focus 0.46

The descent moves the blur radii of the farthest and the nearest point, which the picture tells almost apart;
K is their sum and f the share of the farthest. A gradient only knows the way down, so three short descents
start at a near, a middle and a far focus with much too strong a blur; the best of them goes on.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
import typer
from torch import Tensor

from bokehnet.classical.torch.autograd import scatter
from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_disparity
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.tools.demo import ASSETS

# Radii of the farthest and the nearest point at the start, pixels: blur 40, focus 0.1, 0.5 and 0.9.
STARTS = ((4.0, 36.0), (20.0, 20.0), (36.0, 4.0))


@dataclass(frozen=True)
class Found:
    """Where a descent ended.

    Attributes:
        far, near: Blur radius of disparity 0 and of disparity 1, pixels.
        loss: Mean squared difference of the square roots of both pictures.
    """

    far: float
    near: float
    loss: float

    @property
    def blur(self) -> float:
        """K, pixels of radius per unit of disparity."""
        return self.far + self.near

    @property
    def focus(self) -> float:
        """The disparity that is sharp."""
        return self.far / self.blur


def small_scene(shrink: int) -> tuple[Tensor, Tensor]:
    """Picture (H, W, 3) and disparity (H, W) of the demo, ``shrink`` times smaller, float32."""

    def mean_of_blocks(array: np.ndarray) -> Tensor:
        height, width = array.shape[0] // shrink, array.shape[1] // shrink
        cut = array[: height * shrink, : width * shrink]
        blocks = cut.reshape(height, shrink, width, shrink, *array.shape[2:])
        return torch.from_numpy(blocks.mean((1, 3)))

    return mean_of_blocks(read_image(ASSETS / "demo.png")), mean_of_blocks(
        read_disparity(ASSETS / "demo_disparity.png")
    )


def photograph(image: Tensor, disparity: Tensor, blur: float, focus: float) -> Tensor:
    """Render bokeh and round it to 8-bit sRGB, scene-linear (H, W, 3)."""
    bokeh = scatter(image, defocus_from_disparity(disparity, blur, focus))
    return srgb_to_linear((linear_to_srgb(bokeh.clamp(0, 1)) * 255).round() / 255)


def descend(image: Tensor, disparity: Tensor, bokeh: Tensor, start: Found, steps: int, rate: float) -> Found:
    """Fit the render to ``bokeh`` by Adam; ``rate`` is the first step's length in pixels and sinks to 0."""
    radii = torch.tensor([start.far, start.near], requires_grad=True)
    optimizer = torch.optim.Adam([radii], lr=rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    wanted = _root(bokeh)
    loss = start.loss
    for _ in range(steps):
        optimizer.zero_grad()
        far, near = radii.abs()  # focus lies between far and near
        difference = _root(scatter(image, near * disparity - far * (1 - disparity))) - wanted
        error = difference.square().mean()
        error.backward()
        optimizer.step()
        schedule.step()
        loss = error.item()
    far, near = radii.detach().abs().tolist()
    return Found(far, near, loss)


def recover(
    image: Tensor, disparity: Tensor, bokeh: Tensor, told: Callable[[str, Found], None] | None = None
) -> Found:
    """Find blur and focus of ``bokeh`` (H, W, 3); ``told`` hears of every descent."""
    told = told or (lambda _name, _found: None)
    ends = []
    for radii in STARTS:
        start = Found(*radii, loss=float("nan"))
        ends.append(descend(image, disparity, bokeh, start, steps=60, rate=2.0))
        told(f"started at blur {start.blur:.0f}, focus {start.focus:.2f}", ends[-1])
    best = min(ends, key=lambda end: end.loss)
    found = descend(image, disparity, bokeh, best, steps=100, rate=0.3)
    told("the best went on", found)
    return found


def _root(light: Tensor) -> Tensor:
    """Square root: lamps must not outweigh everything else."""
    return light.clamp(min=1e-6).sqrt()


def main() -> None:
    """Hide blur and focus in a picture, and find them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blur", type=float, default=12.0, help="the true K, pixels of the small picture")
    parser.add_argument("--focus", type=float, default=0.46, help="the true focus, 0 to 1")
    parser.add_argument("--shrink", type=int, default=4, help="the demo's picture is made so much smaller")
    options = parser.parse_args()
    torch.set_num_threads(1)
    image, disparity = small_scene(options.shrink)
    bokeh = photograph(image, disparity, options.blur, options.focus)
    began = time.perf_counter()

    def tell(name: str, found: Found) -> None:
        typer.echo(f"{name}: blur {found.blur:.2f}, focus {found.focus:.3f}, loss {found.loss:.1e}")

    found = recover(image, disparity, bokeh, tell)
    seconds = time.perf_counter() - began
    typer.echo(f"truth: blur {options.blur:.2f}, focus {options.focus:.3f}")
    typer.echo(f"found: blur {found.blur:.2f}, focus {found.focus:.3f}, in {seconds:.0f} s")


if __name__ == "__main__":
    main()

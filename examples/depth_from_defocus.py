"""Estimate focus and blur of a bokeh picture by gradient descent: a small depth-from-defocus example.

Given the all-in-focus picture, its disparity and an 8-bit picture with bokeh, estimate the blur K and the
focus f of ``defocus = K * (disparity - f)``. This command, from the root of the repository, renders with
known values and recovers them::

    python examples/depth_from_defocus.py --blur 12 --focus 0.46

The descent optimizes the blur radii of the farthest and the nearest point, which are nearly independent; K is
their sum, and f is the radius of the farthest divided by K. As gradient descent is local, three short
descents start at a near, a middle and a far focus with a much too strong blur; the best one continues.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import click
import numpy as np
import torch
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
class Estimate:
    """Result of a descent.

    Attributes:
        far, near: Blur radius at disparity 0 and at disparity 1, pixels.
        loss: Mean squared difference of the square roots of both pictures.
    """

    far: float
    near: float
    loss: float

    @property
    def blur(self) -> float:
        """Blur K, pixels of radius per unit of disparity."""
        return self.far + self.near

    @property
    def focus(self) -> float:
        """Disparity in focus."""
        return self.far / self.blur


def small_scene(shrink: int) -> tuple[Tensor, Tensor]:
    """Return picture (H, W, 3) and disparity (H, W) of the demo, reduced by ``shrink``, float32."""

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


def descend(
    image: Tensor, disparity: Tensor, bokeh: Tensor, start: Estimate, steps: int, rate: float
) -> Estimate:
    """Fit the render to ``bokeh`` by Adam; ``rate`` is the initial step in pixels and decays to 0."""
    radii = torch.tensor([start.far, start.near], requires_grad=True)
    optimizer = torch.optim.Adam([radii], lr=rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    target = _root(bokeh)
    loss = start.loss
    for _ in range(steps):
        optimizer.zero_grad()
        far, near = radii.abs()  # focus lies between far and near
        difference = _root(scatter(image, near * disparity - far * (1 - disparity))) - target
        error = difference.square().mean()
        error.backward()
        optimizer.step()
        schedule.step()
        loss = error.item()
    far, near = radii.detach().abs().tolist()
    return Estimate(far, near, loss)


def recover(
    image: Tensor, disparity: Tensor, bokeh: Tensor, report: Callable[[str, Estimate], None] | None = None
) -> Estimate:
    """Estimate blur and focus of ``bokeh`` (H, W, 3); ``report`` is called after every descent."""
    report = report or (lambda _name, _estimate: None)
    estimates = []
    for radii in STARTS:
        start = Estimate(*radii, loss=float("nan"))
        estimates.append(descend(image, disparity, bokeh, start, steps=60, rate=2.0))
        report(f"started at blur {start.blur:.0f}, focus {start.focus:.2f}", estimates[-1])
    best = min(estimates, key=lambda end: end.loss)
    estimate = descend(image, disparity, bokeh, best, steps=100, rate=0.3)
    report("best one continued", estimate)
    return estimate


def _root(light: Tensor) -> Tensor:
    """Return the square root, which reduces the weight of lamps."""
    return light.clamp(min=1e-6).sqrt()


def main() -> None:
    """Render a picture with known blur and focus, and recover them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blur", type=float, default=12.0, help="the true K, pixels of the small picture")
    parser.add_argument("--focus", type=float, default=0.46, help="the true focus, 0 to 1")
    parser.add_argument("--shrink", type=int, default=4, help="reduction factor of the demo picture")
    options = parser.parse_args()
    torch.set_num_threads(1)
    image, disparity = small_scene(options.shrink)
    bokeh = photograph(image, disparity, options.blur, options.focus)
    start_time = time.perf_counter()

    def report(name: str, estimate: Estimate) -> None:
        click.echo(f"{name}: blur {estimate.blur:.2f}, focus {estimate.focus:.3f}, loss {estimate.loss:.1e}")

    estimate = recover(image, disparity, bokeh, report)
    seconds = time.perf_counter() - start_time
    click.echo(f"truth: blur {options.blur:.2f}, focus {options.focus:.3f}")
    click.echo(f"found: blur {estimate.blur:.2f}, focus {estimate.focus:.3f}, in {seconds:.0f} s")


if __name__ == "__main__":
    main()

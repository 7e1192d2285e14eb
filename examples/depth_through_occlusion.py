"""Estimate the depth of blurred bars, and of the wall behind them, by gradient descent through a renderer.

Three bars at different depths stand before a wall in focus. Given are the sharp picture, the wall behind
the bars, the outlines of the bars, and the picture with bokeh, which the rays of the package render from the
true layers. The descent estimates the blur radius of every bar and of the wall at its left and right end,
once with a renderer without occlusion (``scatter``) and once with it (``layered``)::

    python examples/depth_through_occlusion.py
"""

import argparse

import click
import numpy as np
import torch
from torch import Tensor

from bokehnet.classical.known_layers import Layers
from bokehnet.classical.rays_renderer import rays
from bokehnet.torch import layered, scatter

# Signed blur radii, pixels: of the bars, then of the left and right end of the wall; and at the start.
TRUTH = (4.0, 6.0, 8.0, -2.0, 1.0)
START = (6.0, 6.0, 6.0, -0.6, -0.6)

# Left and right side of each bar, columns.
BARS = ((10, 17), (32, 38), (60, 71))
HEIGHT, WIDTH = 48, 84


def make_scene() -> tuple[Tensor, Tensor, Tensor]:
    """Return picture and wall, (1, 3, H, W) each, and the bar of each pixel, 0 for none, (H, W)."""
    rng = np.random.default_rng(0)
    texture = torch.from_numpy(rng.random((2, 3, HEIGHT // 3, WIDTH // 3), np.float32))
    wall, front = texture.repeat_interleave(3, 2).repeat_interleave(3, 3).split(1)
    bar = torch.zeros(HEIGHT, WIDTH, dtype=torch.long)
    for number, (left, right) in enumerate(BARS, 1):
        bar[:, left:right] = number
    return torch.where(bar > 0, 0.5 * front, wall), wall, bar


def defocus_maps(radii: Tensor, bar: Tensor) -> tuple[Tensor, Tensor]:
    """Return the defocus of the picture and of the wall, (1, 1, H, W), for radii as in ``TRUTH``."""
    along = torch.linspace(0, 1, WIDTH)
    wall = (radii[3] + (radii[4] - radii[3]) * along).expand(HEIGHT, WIDTH)
    return torch.where(bar > 0, radii[(bar - 1).clamp(min=0)], wall)[None, None], wall[None, None]


def photograph(image: Tensor, wall: Tensor, bar: Tensor) -> Tensor:
    """Render the true layers with the rays of the package, (1, 3, H, W)."""
    defocus, behind = defocus_maps(torch.tensor(TRUTH), bar)
    colors = torch.stack([image[0], wall[0]], 1).permute(2, 3, 1, 0).numpy()
    radii = torch.stack([defocus[0, 0], behind[0, 0]], -1).numpy()
    stack = Layers(colors=colors, defocus=radii, coverage=np.ones_like(radii))
    return torch.from_numpy(rays(colors[:, :, 0], radii[..., 0], layers=stack)).movedim(2, 0)[None]


def recover(mode: str, image: Tensor, wall: Tensor, bar: Tensor, bokeh: Tensor, steps: int) -> Tensor:
    """Return the radii that a descent through ``"scatter"`` or ``"layered"`` finds."""
    radii = torch.tensor(START, requires_grad=True)
    optimizer = torch.optim.Adam([radii], lr=0.3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for step in range(steps):
        optimizer.zero_grad()
        defocus, behind = defocus_maps(radii, bar)
        if mode == "layered":
            render = layered(image, defocus, [(wall, behind)], samples=8, seed=step)
        else:
            render = scatter(image, defocus)
        (render - bokeh).square().mean().backward()
        optimizer.step()
        schedule.step()
    return radii.detach()


def main() -> None:
    """Print the true radii and those of both descents."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=60, help="steps of each descent")
    options = parser.parse_args()
    torch.set_num_threads(1)
    image, wall, bar = make_scene()
    bokeh = photograph(image, wall, bar)
    click.echo("truth:   " + " ".join(f"{radius:6.2f}" for radius in TRUTH))
    for mode in ("scatter", "layered"):
        radii = recover(mode, image, wall, bar, bokeh, options.steps)
        errors = (radii - torch.tensor(TRUTH)).abs()
        shown = " ".join(f"{radius:6.2f}" for radius in radii.tolist())
        bars, ends = errors[:3].mean(), errors[3:].mean()
        click.echo(f"{mode:8s} {shown}  mean error of the bars {bars:.2f} px, of the wall {ends:.2f} px")


if __name__ == "__main__":
    main()

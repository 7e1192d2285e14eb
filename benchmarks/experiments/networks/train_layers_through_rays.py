"""Corrector of layers that is trained through the rays.

``python -m benchmarks.experiments.networks.train_layers_through_rays CACHE --checkpoints FOLDER``

The renderer estimates what a picture does not show: the colours behind a foreground, and colour and coverage
of pixels at its edge. A small network corrects these estimates. It is trained by the error of the picture
that :func:`bokehnet.torch.layered` renders with the corrected layers, against the traced picture, with exact
maps and with repaired ones. It is scored by the rays of the package on scenes of another kind. Scenes and
maps: :mod:`benchmarks.experiments.networks.views`; ``CACHE`` keeps the scenes.
Checkpoints in ``--checkpoints`` are used again.

Rule: it is of use only if the pictures of repaired maps gain 0.3 dB at edges in the mean and those of exact
maps lose at most 0.02 dB.
"""

import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.experiments.networks.training import (
    INSIDE,
    Batch,
    Crops,
    Phase,
    parse_arguments,
    report_scores,
    train_seeds,
)
from benchmarks.experiments.networks.views import TrainingView, training_views
from bokehnet.classical.layered.layers import Layers, split_layers
from bokehnet.classical.rays_renderer import rays
from bokehnet.optics.encoding import decode, encode
from bokehnet.torch import layered

# Crops per step, pupil samples, learning rate, and fraction of the examples with the exact map.
_BATCH, _SAMPLES, _RATE, _EXACT_FRACTION = 4, 4, 5e-4, 0.5

# Unit of the defocus in the input of the network, pixels.
_DEFOCUS_UNIT_PX = 10.0

# Limits of a correction: of encoded colours, and of the logit of the coverage.
_MAX_COLOR, _MAX_LOGIT = 0.5, 4.0

# Coverage of mixed pixels lies between this and 1 minus this.
_LEAST_COVERAGE = 1e-3


class LayerCorrector(nn.Module):
    """Network that corrects hidden colours, and colour and coverage of mixed pixels.

    Shape:
        colors (B, 2, 3, H, W), scene-linear, defocus (B, 2, H, W), pixels, and coverage (B, 1, H, W) of the
        picture and of the first hidden layer. It starts as the identity.
    """

    def __init__(self, width: int = 32, dilations: tuple[int, ...] = (1, 2, 4, 8, 4, 2, 1)) -> None:
        super().__init__()
        layers: list[nn.Module] = [nn.Conv2d(11, width, 3, padding=1), nn.ELU()]
        for dilation in dilations:
            layers += [nn.Conv2d(width, width, 3, padding=dilation, dilation=dilation), nn.ELU()]
        head = nn.Conv2d(width, 7, 3, padding=1)
        nn.init.zeros_(head.weight)
        if head.bias is not None:
            nn.init.zeros_(head.bias)
        self.body = nn.Sequential(*layers, head)

    def forward(self, colors: Tensor, defocus: Tensor, coverage: Tensor) -> tuple[Tensor, Tensor]:
        """Return the corrected colours and coverage."""
        is_hidden = (defocus[:, :1] != defocus[:, 1:]).float()
        is_mixed = ((coverage > _LEAST_COVERAGE) & (coverage < 1 - _LEAST_COVERAGE)).float()
        front, back = encode(colors[:, 0]), encode(colors[:, 1])
        gap = (defocus / _DEFOCUS_UNIT_PX).tanh()
        change = self.body(torch.cat([front, back, gap, coverage, is_hidden, is_mixed], 1))
        new_front = decode(front + is_mixed * _MAX_COLOR * change[:, :3].tanh()).clamp(min=0)
        new_back = decode(back + is_hidden * _MAX_COLOR * change[:, 3:6].tanh()).clamp(min=0)
        logit = torch.logit(coverage, _LEAST_COVERAGE) + _MAX_LOGIT * change[:, 6:].tanh()
        new_coverage = torch.where(is_mixed > 0, logit.sigmoid(), coverage)
        keep_front, keep_back = is_mixed > 0, is_hidden > 0
        new_colors = [
            torch.where(keep_front, new_front, colors[:, 0]),
            torch.where(keep_back, new_back, colors[:, 1]),
        ]
        return torch.stack(new_colors, 1), new_coverage


def _layers(view: TrainingView, disparity: np.ndarray) -> dict[str, np.ndarray]:
    """Return the first two estimated layers, (2, 3, H, W), (2, H, W), (1, H, W)."""
    stack = split_layers(view.image, view.defocus(disparity))
    number = min(1, stack.defocus.shape[2] - 1)
    return {
        "colors": stack.colors[:, :, [0, number]].transpose(2, 3, 0, 1),
        "defocus": stack.defocus[:, :, [0, number]].transpose(2, 0, 1),
        "coverage": stack.coverage[:, :, :1].transpose(2, 0, 1),
    }


def _render(colors: Tensor, defocus: Tensor, coverage: Tensor, seed: int) -> Tensor:
    hidden = [(colors[:, 1], defocus[:, 1:])]
    return layered(colors[:, 0], defocus[:, :1], hidden, coverage, samples=_SAMPLES, seed=seed)


def _picture_error(network: LayerCorrector, batch: Batch) -> tuple[Tensor, Tensor]:
    """Return the squared error of the rendered picture after and before correction.

    It is the product of the errors of two renders with independent samples, so that noise adds nothing.
    """
    truth, defocus, seeds = encode(batch["truth"]), batch["defocus"], batch["seeds"].tolist()

    def error(colors: Tensor, coverage: Tensor) -> Tensor:
        first, second = (encode(_render(colors, defocus, coverage, seed)) - truth for seed in seeds)
        return (first * second)[INSIDE].mean()

    with torch.no_grad():
        before = error(batch["colors"], batch["coverage"])
    return error(*network(batch["colors"], defocus, batch["coverage"])), before


@torch.no_grad()
def _corrected(network: LayerCorrector, stack: Layers) -> Layers:
    """Return layers with a corrected first and second layer."""
    if stack.defocus.shape[2] < 2:
        return stack
    colors = torch.from_numpy(stack.colors[:, :, :2].transpose(2, 3, 0, 1).copy())[None]
    defocus = torch.from_numpy(stack.defocus[:, :, :2].transpose(2, 0, 1).copy())[None]
    coverage = torch.from_numpy(stack.coverage[:, :, :1].transpose(2, 0, 1).copy())[None]
    new_colors, new_coverage = network(colors, defocus, coverage)
    all_colors, all_coverage = stack.colors.copy(), stack.coverage.copy()
    all_colors[:, :, :2] = new_colors[0].permute(2, 3, 0, 1).numpy()
    all_coverage[:, :, 0] = new_coverage[0, 0].numpy()
    return Layers(colors=all_colors, defocus=stack.defocus, coverage=all_coverage)


def main() -> None:
    """Entry of the command line."""
    arguments = parse_arguments(__doc__, scenes=60, steps=800)
    crops = Crops(training_views(arguments.cache, arguments.scenes, 0), _layers, _EXACT_FRACTION)

    def draw(rng: np.random.Generator, count: int) -> Batch:
        return crops(rng, count) | {"seeds": torch.from_numpy(rng.choice(1 << 16, 2, replace=False))}

    phase = Phase(
        name="layers",
        draw=draw,
        error=_picture_error,
        rate=_RATE,
        crops=_BATCH,
        steps=arguments.steps,
    )
    networks = train_seeds(arguments, LayerCorrector, [phase])

    def render(view: TrainingView) -> dict[str, np.ndarray]:
        defocus = view.defocus(view.repaired)
        stack = split_layers(view.image, defocus)
        stacks = {"default": stack}
        stacks |= {name: _corrected(network, stack) for name, network in networks.items()}
        return {name: rays(view.image, defocus, layers=layers) for name, layers in stacks.items()}

    report_scores(arguments, render)


if __name__ == "__main__":
    main()

"""Corrector of depth maps that is trained through the rays.

``python -m benchmarks.experiments.networks.train_through_rays CACHE --checkpoints FOLDER``

A small network moves the edges of a map that the repair has left, in the range of the depths around each
pixel. It is trained twice: first by depth, the cross entropy of the position between the local extremes;
then through the rays, by the error of the picture that :func:`bokehnet.torch.layered` renders with the
corrected map, against the traced picture. Both states are scored by the rays of the package on scenes of
another kind. Scenes and maps: :mod:`benchmarks.experiments.networks.views`; ``CACHE`` keeps the scenes.
Checkpoints in ``--checkpoints`` are used again.

Rule: it is of use only if wrong maps gain 0.3 dB at edges in the mean and exact maps lose at most 0.02 dB.
"""

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from benchmarks.experiments.networks.training import (
    INSIDE,
    Batch,
    Phase,
    parse_arguments,
    report_scores,
    train_seeds,
)
from benchmarks.experiments.networks.views import TrainingView, busy_window, training_views
from bokehnet.classical.rays_renderer import rays
from bokehnet.optics.encoding import encode
from bokehnet.torch import layered, split_layers

# Half-width in pixels of the window whose extremes bound a correction.
_REACH_PX = 3

# Crops per step and pupil samples.
_BATCH, _SAMPLES = 2, 4

# Steps and crops per step of the training by depth, and the disparity step of half weight, as a fraction of
# the range.
_DEPTH_STEPS, _DEPTH_BATCH, _HALF_WEIGHT_STEP = 1500, 8, 0.05

# Fraction of the examples with the exact map.
_EXACT_FRACTION = 0.35

_DEPTH_RATE, _RATE = 2e-3, 5e-4


class Corrector(nn.Module):
    """Network that corrects a map within its local extremes.

    Shape:
        image (B, 3, H, W), scene-linear; disparity (B, 1, H, W). It starts as the identity.
    """

    def __init__(self, width: int = 24, depth: int = 4) -> None:
        super().__init__()
        layers: list[nn.Module] = [nn.Conv2d(5, width, 3, padding=1), nn.ELU()]
        for number in range(depth):
            dilation = 2 ** (number % 3)
            layers += [nn.Conv2d(width, width, 3, padding=dilation, dilation=dilation), nn.ELU()]
        head = nn.Conv2d(width, 1, 3, padding=1)
        nn.init.zeros_(head.weight)
        self.body = nn.Sequential(*layers, head)

    def positions(self, image: Tensor, disparity: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return positions between the local extremes before and after, and the width between them."""
        low, high = _extremes(disparity)
        position = ((disparity - low) / (high - low + 0.01)).clamp(0.02, 0.98)
        logit = self.body(torch.cat([encode(image), position, high - low], 1))
        return position, (torch.logit(position) + logit).sigmoid(), high - low

    def forward(self, image: Tensor, disparity: Tensor) -> Tensor:
        """Return the corrected disparity."""
        before, after, width = self.positions(image, disparity)
        return disparity + width * (after - before)


def _extremes(disparity: Tensor) -> tuple[Tensor, Tensor]:
    """Return the local minimum and maximum of a map."""
    side = 2 * _REACH_PX + 1
    low = -F.max_pool2d(-disparity, side, 1, _REACH_PX)
    return low, F.max_pool2d(disparity, side, 1, _REACH_PX)


def _batch(views: list[TrainingView], rng: np.random.Generator, count: int) -> Batch:
    """Draw crops at depth edges."""
    rows: dict[str, list[np.ndarray]] = {key: [] for key in ("image", "map", "true", "truth", "numbers")}
    for _ in range(count):
        view = views[int(rng.integers(len(views)))]
        window = busy_window(view.true, rng)
        source = view.true if rng.random() < _EXACT_FRACTION else view.repaired
        rows["image"].append(view.image[window].transpose(2, 0, 1))
        rows["map"].append(source[window][None])
        rows["true"].append(view.true[window][None])
        rows["truth"].append(view.truth[window].transpose(2, 0, 1))
        rows["numbers"].append(np.array([view.blur, view.focus], np.float32))
    return {key: torch.from_numpy(np.stack(values).astype(np.float32)) for key, values in rows.items()}


def _render(image: Tensor, disparity: Tensor, numbers: Tensor) -> Tensor:
    """Render through layers; the hidden layers are constants, the visible surface has the gradient."""
    blur, focus = numbers[:, 0, None, None, None], numbers[:, 1, None, None, None]
    defocus = blur * (disparity - focus)
    first, radius, background, coverage = split_layers(image, defocus.detach())
    radius = radius + (defocus - defocus.detach())
    return layered(first, radius, background, coverage, samples=_SAMPLES)


def _depth_error(network: Corrector, batch: Batch) -> tuple[Tensor, Tensor]:
    """Return the cross entropy of the positions after and before correction."""
    before, after, width = network.positions(batch["image"], batch["map"])
    target = ((batch["true"] - _extremes(batch["map"])[0]) / width.clamp(min=1e-6)).clamp(0, 1)
    weight = width / (width + _HALF_WEIGHT_STEP)
    errors = [F.binary_cross_entropy(x, target, weight) for x in (after, before)]
    return errors[0], errors[1].detach()


def _picture_error(network: Corrector, batch: Batch) -> tuple[Tensor, Tensor]:
    """Return the error of the rendered picture after and before correction."""
    truth = encode(batch["truth"])

    def error(disparity: Tensor) -> Tensor:
        picture = encode(_render(batch["image"], disparity, batch["numbers"]))
        return (picture - truth)[INSIDE].abs().mean()

    with torch.no_grad():
        before = error(batch["map"])
    return error(network(batch["image"], batch["map"])), before


@torch.no_grad()
def _corrected(network: Corrector, image: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    picture = torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)))[None]
    result: np.ndarray = network(picture, torch.from_numpy(disparity)[None, None])[0, 0].numpy()
    return result


def main() -> None:
    """Entry of the command line."""
    arguments = parse_arguments(__doc__, scenes=60, steps=800)
    views = training_views(arguments.cache, arguments.scenes, 0)

    def draw(rng: np.random.Generator, count: int) -> Batch:
        return _batch(views, rng, count)

    phases = (
        Phase(
            name="depth",
            draw=draw,
            error=_depth_error,
            rate=_DEPTH_RATE,
            crops=_DEPTH_BATCH,
            steps=_DEPTH_STEPS,
        ),
        Phase(
            name="rays",
            draw=draw,
            error=_picture_error,
            rate=_RATE,
            crops=_BATCH,
            steps=arguments.steps,
        ),
    )
    networks = train_seeds(arguments, Corrector, phases)

    def render(view: TrainingView) -> dict[str, np.ndarray]:
        maps = {"default": view.repaired}
        maps |= {name: _corrected(network, view.image, view.repaired) for name, network in networks.items()}
        return {name: rays(view.image, view.defocus(disparity)) for name, disparity in maps.items()}

    report_scores(arguments, render)


if __name__ == "__main__":
    main()

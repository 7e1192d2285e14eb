"""Corrector of pictures behind the rays, gated by their expected error.

``python -m benchmarks.experiments.networks.train_behind_rays CACHE --checkpoints FOLDER``

A network sees the picture, the render of the rays, the defocus, and the expected error of the render, and
corrects the render by a residual. A gate bounds the residual: it is open where the error is expected to be
large, and closed where the rays are expected to be right. It is trained on the picture, with exact maps and
with repaired ones, and scored on scenes of another kind. Scenes and maps:
:mod:`benchmarks.experiments.networks.views`; ``CACHE`` keeps the scenes. Checkpoints in ``--checkpoints`` are
used again.

Rule: it is of use only if wrong maps gain 0.3 dB at edges in the mean and exact maps lose at most 0.02 dB.
"""

import numpy as np
import torch
import torch.nn.functional as F
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
from bokehnet import BokehRenderer
from bokehnet.engines.options import RenderOptions
from bokehnet.optics.encoding import decode, encode

# Crops per step, learning rate, and fraction of the examples with the exact map.
_BATCH, _RATE, _EXACT_FRACTION = 8, 1e-3, 0.35

# Unit of the defocus in the input of the network, pixels, and expected error at which the gate is open to
# 1 - 1/e, levels of 8 bits.
_DEFOCUS_UNIT_PX, _GATE_LEVELS = 10.0, 8.0

# Limit of a residual of encoded colours.
_MAX_RESIDUAL = 0.25

_PLANES = ("image", "rays", "defocus", "error")


class GatedCorrector(nn.Module):
    """Network that adds a residual to a render where its error is expected to be large.

    Shape:
        image and rays (B, 3, H, W), scene-linear; defocus, pixels, and error, levels of 8 bits,
        (B, 1, H, W). It starts as the identity.

    Source of the normalisation:
        Zhang and Sennrich, "Root mean square layer normalization", NeurIPS 2019. Without it, half of the
        trainings do not start.
    """

    def __init__(self, width: int = 24, dilations: tuple[int, ...] = (1, 2, 4, 8, 4, 2, 1)) -> None:
        super().__init__()
        self.stem = nn.Conv2d(9, width, 3, padding=1)
        self.layers = nn.ModuleList(
            nn.Conv2d(width, width, 3, padding=dilation, dilation=dilation) for dilation in dilations
        )
        self.head = nn.Conv2d(width, 3, 3, padding=1)
        nn.init.zeros_(self.head.weight)
        if self.head.bias is not None:
            nn.init.zeros_(self.head.bias)

    def forward(self, image: Tensor, rays: Tensor, defocus: Tensor, error: Tensor) -> Tensor:
        """Return the corrected render, encoded."""
        gate = 1 - (-error.clamp(min=0) / _GATE_LEVELS).exp()
        encoded, gap = encode(rays), (defocus / _DEFOCUS_UNIT_PX).tanh()
        features = self.stem(torch.cat([encode(image), encoded, gap, gap.abs(), gate], 1))
        for layer in self.layers:
            features = features + 0.5 * layer(F.elu(_normalised(features)))
        residual = self.head(F.elu(_normalised(features)))
        return encoded + gate * _MAX_RESIDUAL * residual.tanh()


def _normalised(features: Tensor) -> Tensor:
    """Return features with a mean square of 1 in each pixel."""
    return features * torch.rsqrt(features.square().mean(1, keepdim=True) + 1e-3)


def _planes(view: TrainingView, disparity: np.ndarray, renderer: BokehRenderer) -> dict[str, np.ndarray]:
    """Return what the network sees, (C, H, W) float32 by name."""
    defocus = view.defocus(disparity)
    result = renderer.render_arrays(view.image, defocus, options=RenderOptions(expected_error=True))
    assert result.expected_error is not None
    return {
        "image": view.image.transpose(2, 0, 1),
        "rays": np.asarray(result.bokeh, np.float32).transpose(2, 0, 1),
        "defocus": defocus[None],
        "error": np.asarray(result.expected_error, np.float32)[None],
    }


def _picture_error(network: GatedCorrector, batch: Batch) -> tuple[Tensor, Tensor]:
    """Return the squared error of the picture after and before correction."""
    truth = encode(batch["truth"])
    corrected = network(*(batch[name] for name in _PLANES))
    after, before = (
        (picture - truth)[INSIDE].square().mean() for picture in (corrected, encode(batch["rays"]))
    )
    return after, before


@torch.no_grad()
def _corrected(network: GatedCorrector, planes: dict[str, np.ndarray]) -> np.ndarray:
    batch = (torch.from_numpy(np.ascontiguousarray(planes[name]))[None] for name in _PLANES)
    picture: np.ndarray = decode(network(*batch))[0].permute(1, 2, 0).clamp(min=0).numpy()
    return picture


def main() -> None:
    """Entry of the command line."""
    arguments = parse_arguments(__doc__, scenes=60, steps=3000)
    renderer = BokehRenderer("rays")

    def see(view: TrainingView, disparity: np.ndarray) -> dict[str, np.ndarray]:
        return _planes(view, disparity, renderer)

    phase = Phase(
        name="behind rays",
        draw=Crops(training_views(arguments.cache, arguments.scenes, 0), see, _EXACT_FRACTION),
        error=_picture_error,
        rate=_RATE,
        crops=_BATCH,
        steps=arguments.steps,
    )
    networks = train_seeds(arguments, GatedCorrector, [phase])

    def render(view: TrainingView) -> dict[str, np.ndarray]:
        planes = see(view, view.repaired)
        pictures = {name: _corrected(network, planes) for name, network in networks.items()}
        return {"default": planes["rays"].transpose(1, 2, 0)} | pictures

    report_scores(arguments, render)


if __name__ == "__main__":
    main()

"""Train BokehMe's networks: ``python -m train.train_bokehme --config CONFIG --out FOLDER``.

Without ``arnet`` in the configuration this trains ARNet, with it IUNet behind that fixed ARNet. One
scene-linear pair serves every gamma: the encoded picture is ``light ** (1 / gamma)``, and the traced bokeh,
encoded likewise, is the truth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from bokehnet.inference.bokehme import (
    DISPLAY_GAMMA,
    GAMMA_RANGE,
    UNIT_PX,
    coarse_dilation,
    normalised_gamma,
    refine_to_full_size,
    render_bokehme,
    resize,
)
from bokehnet.models.bokehme import BokehMeConfig
from bokehnet.models.checkpoint import load_network
from train.data.crops import DataConfig, PreparedCrops
from train.run.command import run_command
from train.run.logbook import over_held_out
from train.run.schedule import OptimConfig
from train.run.task import Task, run_task
from train.scores.losses import bokehme_loss
from train.scores.metrics import compare, mean_scores
from train.scores.validation import HeldOut, held_out_examples

__all__ = ["BokehMeRun", "main"]


@dataclass(frozen=True, kw_only=True)
class BokehMeRun:
    """A training run of one of BokehMe's networks.

    Attributes:
        data, optim, model: Configurations of these parts.
        arnet: Checkpoint or export of the trained ARNet; empty trains ARNet itself.
        start: Checkpoint or export with the initial weights of a new run; empty: random weights.
        held_out: Number of held-out pictures scored at each validation.
    """

    data: DataConfig
    optim: OptimConfig
    model: BokehMeConfig = field(default_factory=BokehMeConfig)
    arnet: str = ""
    start: str = ""
    held_out: int = 12


class _CropsWithGamma:
    """Source of crops, each with a gamma; picklable.

    Args:
        crops: Source of the crops.
    """

    def __init__(self, crops: PreparedCrops) -> None:
        self.crops = crops

    def draw(self, rng: np.random.Generator) -> dict[str, Tensor]:
        """Draw one example; its ``gamma`` has shape (1, 1, 1).

        Half of the examples have the gamma of displays, the others any.
        """
        example = self.crops.draw(rng)
        gamma = DISPLAY_GAMMA if rng.random() < 0.5 else rng.uniform(*GAMMA_RANGE)
        return example | {"gamma": torch.full((1, 1, 1), gamma, dtype=torch.float32)}


def _encoded(batch: dict[str, Tensor], *names: str) -> list[Tensor]:
    """Return pictures of a batch, encoded by the gamma of each example."""
    return [batch[name].clamp(min=0) ** (1 / batch["gamma"]) for name in names]


def _arnet_loss(network: nn.Module, batch: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
    image, truth, classical = _encoded(batch, "image", "truth", "classical")
    bokeh, error_map = network(image, batch["defocus"], normalised_gamma(batch["gamma"]))
    return bokehme_loss([(bokeh, truth, batch["target"])], error_map, classical)


def _iunet_loss(
    arnet: nn.Module, network: nn.Module, batch: dict[str, Tensor]
) -> tuple[Tensor, dict[str, Tensor]]:
    image, truth = _encoded(batch, "image", "truth")
    defocus, height, width = batch["defocus"], *image.shape[-2:]
    # At least one step of upsampling, so that every batch teaches.
    factor = max(2.0, float(defocus.abs().max()) / UNIT_PX)
    size = [2 * round(0.5 * side / factor) for side in (height, width)]
    small = resize(defocus, *size) / factor
    gamma = normalised_gamma(batch["gamma"])
    with torch.no_grad():
        coarse, _ = arnet(resize(image, *size), small, gamma)
        dilated = torch.from_numpy(coarse_dilation(small.cpu().numpy())).to(defocus)
    pictures = refine_to_full_size(network, image, defocus, gamma, coarse, dilated)
    steps = [(x, *(resize(y, *x.shape[-2:]) for y in (truth, batch["target"]))) for x in pictures]
    return bokehme_loss(steps)


@torch.no_grad()
def _score(
    arnet: nn.Module, iunet: nn.Module | None, held_out: HeldOut, device: torch.device
) -> tuple[dict[str, float], dict[str, Tensor]]:
    """Return mean scores of the networks alone, of the fusion, and of the classical render."""
    rows, pictures = [], {}
    for number, example in enumerate(over_held_out(held_out.examples)):
        names = ("image", "classical", "truth")
        image, classical, truth = (example[name].to(device).clamp(min=0) for name in names)
        encoded, encoded_classical = image ** (1 / DISPLAY_GAMMA), classical ** (1 / DISPLAY_GAMMA)
        defocus, gamma = example["defocus"].to(device), image.new_full((1, 1, 1, 1), DISPLAY_GAMMA)
        result = render_bokehme(
            encoded,
            defocus,
            encoded_classical,
            gamma,
            arnet=arnet,
            iunet=iunet or _Interpolation(),
            dilate=lambda x: torch.from_numpy(coarse_dilation(x.cpu().numpy())).to(x),
        )
        shown = {"classical": encoded_classical, "neural": result.neural, "fused": result.bokeh}
        linear = {name: x.clamp(min=0) ** DISPLAY_GAMMA for name, x in shown.items()}
        arrays = {
            name: x[0].permute(1, 2, 0).cpu().numpy() for name, x in (linear | {"truth": truth}).items()
        }
        radius = example["defocus"][0, 0].numpy()
        rows.append(
            {
                f"{name}/{key}": value
                for name in shown
                for key, value in compare(arrays[name], arrays["truth"], radius).items()
            }
        )
        if number < 4:
            row = [*(x[0] for x in shown.values()), truth[0] ** (1 / DISPLAY_GAMMA)]
            row.append(result.error_map[0].expand(3, -1, -1))
            pictures[f"classical_neural_fused_truth_error/{number}"] = (
                torch.cat(row, dim=-1).clamp(0, 1).cpu()
            )
    return mean_scores(rows), pictures


class _Interpolation(nn.Module):
    """Stand-in for IUNet while ARNet trains: interpolates the coarse picture."""

    def forward(self, image: Tensor, _: Tensor, coarse: Tensor, __: Tensor) -> Tensor:
        """Return ``coarse`` at the size of ``image``."""
        return resize(coarse, *image.shape[-2:])


def task(config: BokehMeRun, device: torch.device) -> Task:
    """Return the definition of this training."""
    held_out = held_out_examples(config.data.validation, config.held_out)
    if not config.arnet:
        return Task(
            network="bokehme_arnet",
            source=lambda: _CropsWithGamma(PreparedCrops(config.data, UNIT_PX)),
            loss_of=_arnet_loss,
            validate=lambda network: _score(network, None, held_out, device),
        )
    arnet = load_network(Path(config.arnet), "bokehme_arnet").requires_grad_(False).to(device)
    return Task(
        network="bokehme_iunet",
        source=lambda: _CropsWithGamma(PreparedCrops(config.data)),
        loss_of=lambda network, batch: _iunet_loss(arnet, network, batch),
        validate=lambda network: _score(arnet, network, held_out, device),
    )


def run(config: BokehMeRun, out: Path, device: torch.device, max_minutes: float) -> Path:
    """Train, or resume training; return the path of the checkpoint."""
    return run_task(task(config, device), config, out, device, max_minutes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry of the command line."""
    run_command(__doc__, BokehMeRun, run, arguments)


if __name__ == "__main__":
    main()

"""Scores of a network on held-out, ray-traced scenes during training."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from bokehnet.engine_registry import CLASSICAL
from bokehnet.inference.coarse_to_fine import RefineNetwork, render_neural
from bokehnet.io.color.srgb import linear_to_srgb
from train.data.prepared import PLANES, PreparedSet
from train.run.logbook import over_held_out
from train.scores.metrics import compare, mean_scores

__all__ = ["HeldOut", "held_out_examples", "score_coarse_to_fine"]


@dataclass(frozen=True, slots=True, eq=False)
class HeldOut:
    """Whole examples, planes (1, C, H, W) by name, and the name of their classical renderer."""

    examples: list[dict[str, Tensor]]
    classical: str


def held_out_examples(folder: str, limit: int) -> HeldOut:
    """Return at most ``limit`` examples, evenly spaced in a prepared set."""
    prepared = PreparedSet(folder)
    indices = np.unique(np.linspace(0, len(prepared) - 1, min(limit, len(prepared))).astype(int))
    examples = []
    for index in indices:
        planes = torch.from_numpy(prepared[int(index)].astype(np.float32))[None]
        example = {name: planes[:, place] for name, place in PLANES.items()}
        example["features"] = torch.cat(
            [example["occluded_background"], example["disocclusion_weight"], example["classical_error_map"]],
            dim=1,
        )
        examples.append(example)
    return HeldOut(examples, prepared.classical)


def _array(tensor: Tensor) -> np.ndarray:
    return tensor[0].permute(1, 2, 0).float().cpu().numpy()


@torch.no_grad()
def score_coarse_to_fine(
    arnet: nn.Module,
    iunet: RefineNetwork | None,
    network_max_radius: float,
    held_out: HeldOut,
    device: torch.device,
) -> tuple[dict[str, float], dict[str, Tensor]]:
    """Render all examples with the hybrid; return mean hybrid and classical scores, and a few pictures."""
    rows, pictures = [], {}
    for number, example in enumerate(over_held_out(held_out.examples)):
        keys = ("image", "defocus", "classical", "classical_error_map", "features")
        image, radius, classical, classical_error_map, features = (example[key].to(device) for key in keys)
        defocus = example["defocus"][0, 0].numpy()
        result = render_neural(
            image,
            radius,
            classical,
            classical_error_map,
            features=features,
            arnet=arnet,
            iunet=iunet,
            network_max_radius=network_max_radius,
            leaves_outlines=CLASSICAL[held_out.classical].sharp_foregrounds,
        )
        truth = _array(example["truth"])
        scores = {f"hybrid/{key}": x for key, x in compare(_array(result.bokeh), truth, defocus).items()}
        scores |= {f"classical/{key}": x for key, x in compare(_array(classical), truth, defocus).items()}
        rows.append(scores)
        if number < 4:
            shown = [classical, result.picture, result.bokeh, example["truth"].to(device)]
            encoded = [linear_to_srgb(picture.clamp(0, 1))[0] for picture in shown]
            encoded.append(result.error_map[0].expand(3, -1, -1))
            pictures[f"classical_neural_hybrid_truth_error/{number}"] = torch.cat(encoded, dim=-1).cpu()
    scores = mean_scores(rows)
    scores["gain/edge_psnr"] = scores["hybrid/edge_psnr"] - scores["classical/edge_psnr"]
    scores["gain/psnr"] = scores["hybrid/psnr"] - scores["classical/psnr"]
    return scores, pictures

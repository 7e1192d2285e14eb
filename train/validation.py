"""What a network is worth on held-out, ray-traced scenes, while it trains."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from bokehnet.cascade import render_neural
from bokehnet.fusion import fuse
from bokehnet.io.color import linear_to_srgb
from bokehnet.synth.shards import ShardSet
from train.data import DataConfig, Example, make_example
from train.metrics import compare, mean_scores

__all__ = ["HeldOut", "held_out_examples", "score_cascade"]


@dataclass(frozen=True)
class HeldOut:
    """Clean examples of held-out scenes, (1, C, H, W) each, and their true defocus (H, W)."""

    examples: list[Example]
    defocus: list[np.ndarray]


def held_out_examples(config: DataConfig, limit: int) -> HeldOut:
    """The first views of at most ``limit`` held-out samples, spread over the set."""
    samples = ShardSet(Path(config.validation))
    chosen = np.unique(np.linspace(0, len(samples) - 1, min(limit, len(samples))).astype(int))
    examples = []
    for index in chosen:
        sample = samples[int(index)]
        example = make_example(sample, int(index) % len(sample.blur), None, config)
        examples.append({name: x[None] for name, x in example.items()})
    return HeldOut(examples, [example["defocus"][0, 0].numpy() for example in examples])


def _array(tensor: Tensor) -> np.ndarray:
    return tensor[0].permute(1, 2, 0).float().cpu().numpy()


@torch.no_grad()
def score_cascade(
    arnet: nn.Module, iunet: nn.Module, unit: float, held_out: HeldOut, device: torch.device
) -> tuple[dict[str, float], dict[str, Tensor]]:
    """Render all examples with the hybrid; mean scores beside the scatter's, and pictures of a few."""
    rows, pictures = [], {}
    for number, (example, defocus) in enumerate(zip(held_out.examples, held_out.defocus, strict=True)):
        keys = ("image", "defocus", "classical", "error_map")
        image, radius, classical, doubt = (example[key].to(device) for key in keys)
        result = render_neural(image, radius, classical, doubt, arnet=arnet, iunet=iunet, unit=unit)
        hybrid = fuse(classical, result.steps[-1], result.error_map)
        truth = _array(example["truth"])
        scores = {f"hybrid/{key}": x for key, x in compare(_array(hybrid), truth, defocus).items()}
        scores |= {f"scatter/{key}": x for key, x in compare(_array(classical), truth, defocus).items()}
        rows.append(scores)
        if number < 4:
            shown = [classical, result.steps[-1], hybrid, example["truth"].to(device)]
            encoded = [linear_to_srgb(picture.clamp(0, 1))[0] for picture in shown]
            encoded.append(result.error_map[0].expand(3, -1, -1))
            pictures[f"classical_neural_hybrid_truth_error/{number}"] = torch.cat(encoded, dim=-1).cpu()
    scores = mean_scores(rows)
    scores["gain/edge_psnr"] = scores["hybrid/edge_psnr"] - scores["scatter/edge_psnr"]
    scores["gain/psnr"] = scores["hybrid/psnr"] - scores["scatter/psnr"]
    return scores, pictures

"""Textures of random surfaces: photographs and patterns."""

import numpy as np

from bokehnet.raytrace.surfaces.textures import TEXTURES, dead_leaves
from bokehnet.synth.config import SceneConfig
from bokehnet.synth.photographs import crop_photograph, photograph_files

__all__ = ["MIDDLE_GREY", "surface_texture"]

MIDDLE_GREY = 0.18


def surface_texture(
    recipe: SceneConfig, height: int, width: int, rng: np.random.Generator, photograph: float = 0.65
) -> np.ndarray:
    """Return colours (H, W, 3) with a random mean around middle grey.

    Args:
        recipe: Selection of photographs.
        height: Height, texels.
        width: Width, texels.
        rng: Random generator.
        photograph: Probability of a photograph instead of a pattern.
    """

    def draw_photograph(height: int, width: int, rng: np.random.Generator) -> np.ndarray:
        files = photograph_files(recipe.photographs, recipe.photograph_folder)
        return crop_photograph(files[rng.integers(len(files))], height, width, rng)

    if rng.random() < photograph:
        colours = draw_photograph(height, width, rng)
    elif rng.random() < 0.5:
        colours = dead_leaves(height, width, rng, draw_photograph if rng.random() < 0.6 else None)
    else:
        colours = TEXTURES[list(TEXTURES)[rng.integers(len(TEXTURES))]](height, width, rng)
    mean = MIDDLE_GREY * 2 ** rng.normal(0, 0.8)
    return colours * np.float32(mean / max(float(colours.mean()), 0.02))

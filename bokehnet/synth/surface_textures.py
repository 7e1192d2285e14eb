"""What random surfaces are painted with: photographs and patterns."""

import numpy as np

from bokehnet.raytrace.surfaces.textures import TEXTURES, dead_leaves
from bokehnet.synth.config import SceneConfig
from bokehnet.synth.photographs import crop_photograph, photograph_files

__all__ = ["MIDDLE_GREY", "surface_texture"]

MIDDLE_GREY = 0.18


def surface_texture(
    recipe: SceneConfig, height: int, width: int, rng: np.random.Generator, photograph: float = 0.65
) -> np.ndarray:
    """Return colours (H, W, 3) whose mean is some stops around middle grey.

    Args:
        recipe: Which photographs.
        height: Texels.
        width: Texels.
        rng: Random numbers.
        photograph: Probability of a photograph; else there is a pattern.
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
    wanted = MIDDLE_GREY * 2 ** rng.normal(0, 0.8)
    return colours * np.float32(wanted / max(float(colours.mean()), 0.02))

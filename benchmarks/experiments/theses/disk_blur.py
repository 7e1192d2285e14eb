"""Agreement with the reference pictures of another program's disc blur.

Run ``python -m benchmarks.experiments.theses.disk_blur FOLDER`` with the files ``diskBlurSource.exr``,
``diskBlurred.exr`` and ``diskBlurredWithPlanes.exr`` of the folder ``python/GafferImageTest/images`` of
github.com/GafferHQ/gaffer. Its blur adds discs without dividing by their sum; with planes it cuts the picture
at every half pixel of radius, and a layer hides all layers but the next one behind it.
"""

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np

from bokehnet.baselines import perimeter, spread_pixel_layers
from bokehnet.baselines.spread.layered_spreading import composite_layers
from bokehnet.baselines.spread.spreading import spread_outlines
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.io.channels import read_channels
from bokehnet.optics.aperture import Aperture

# Boundaries of the planes, pixels of radius, negative in front.
_PLANES = [-np.inf, *(0.5 * step for step in range(-15, 15)), np.inf]


def _read(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return colours (H, W, 3), alpha and radius (H, W)."""
    channels = read_channels(path).channels
    colors = np.stack([channels[name] for name in "RGB"], -1)
    return colors.astype(np.float32), channels["A"], channels["radius"].astype(np.float32)


def behind_all_but_next(layers: list[np.ndarray]) -> np.ndarray:
    """Return layers (H, W, 4), front to back, each hidden by those more than one before it, over alpha."""
    passing = [np.ones(layers[0].shape[:2]), np.ones(layers[0].shape[:2])]
    total = np.zeros_like(layers[0])
    for layer in layers:
        total += np.maximum(passing[-2], 0)[..., None] * layer
        passing.append(passing[-1] - passing[-2] * layer[..., 3])
    return np.asarray(total[..., :3] / np.maximum(total[..., 3:], 1e-9))


def _db(first: np.ndarray, second: np.ndarray) -> float:
    return float(-10 * np.log10(((first - second) ** 2).mean()))


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    image, _, radius = _read(folder / "diskBlurSource.exr")
    defocus = -radius
    plain, planes = (
        colors / np.maximum(alpha, 1e-6)[..., None]
        for colors, alpha, _ in (
            _read(folder / f"{name}.exr") for name in ("diskBlurred", "diskBlurredWithPlanes")
        )
    )
    bounds = list(pairwise(_PLANES))
    layers = [
        spread_outlines(image, defocus, Aperture(), (radius >= low) & (radius < high)) for low, high in bounds
    ]
    methods = {
        "scatter": scatter(image, defocus),
        "perimeter": perimeter(image, defocus),
        "planes, hidden by all but the next": behind_all_but_next(layers),
        "planes, hidden by all": composite_layers(layers, image),
        "spread_pixel_layers": spread_pixel_layers(image, defocus),
    }
    print("PSNR, dB, against their picture without and with planes, both divided by alpha")
    for name, picture in methods.items():
        print(f"  {name:36s}{_db(picture, plain):8.2f}{_db(picture, planes):8.2f}")


if __name__ == "__main__":
    main()

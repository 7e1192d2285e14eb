"""Lommel's functions compared with a Fourier transform: ``python -m benchmarks.experiments.lenses.lommel``.

Prints, for defocus from 0 to 20 waves, the difference of the intensity around a point between
:func:`bokehnet.baselines.spread.lommel_functions.lommel_intensity` and the Fourier transform of a pupil with
defocus phase, relative to the L2 norm of the latter over the plane.
"""

import argparse
import math

import numpy as np

from bokehnet.baselines.spread.lommel_functions import lommel_intensity

__all__ = ["CELLS", "relative_error", "transformed_pupil"]

# Cells across the pupil radius, and padding factor of the transform.
CELLS, _PADDING = 1024, 8


def transformed_pupil(waves: float, cells: int = CELLS) -> tuple[np.ndarray, np.ndarray]:
    """Return distances v up to twice the disc, and the intensity by FFT of a defocused pupil: a central cut.

    Rows of the pupil are summed first: the transform of the sums is the central row of the transform.

    Args:
        waves: Defocus at the pupil edge, waves.
        cells: Number of cells along the pupil radius.
    """
    position = (np.arange(-cells, cells) + 0.5) / cells
    rho2 = position[None, :] ** 2 + position[:, None] ** 2
    soft = np.clip((1 - np.sqrt(rho2)) * cells + 0.5, 0, 1)
    columns = (soft * np.exp(2j * math.pi * waves * rho2)).sum(axis=0)
    padded = np.zeros(2 * _PADDING * cells, complex)
    padded[: 2 * cells] = columns
    field = np.fft.fft(padded) / soft.sum()
    v = 2 * math.pi * cells * np.arange(len(padded)) / len(padded)
    in_range = v <= max(2 * 4 * math.pi * waves, 30)
    return v[in_range], np.abs(field[in_range]) ** 2


def relative_error(waves: float, cells: int = CELLS) -> float:
    """Return the relative L2 norm of the difference; rings are weighted by their circumference."""
    v, expected = transformed_pupil(waves, cells)
    intensity = lommel_intensity(4 * math.pi * waves, v)
    return math.sqrt((v * (intensity - expected) ** 2).sum() / (v * expected**2).sum())


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--most", type=float, default=20.0, help="maximum defocus, waves")
    parser.add_argument("--step", type=float, default=0.5, help="step, waves")
    arguments = parser.parse_args()
    worst = 0.0
    for waves in np.arange(0, arguments.most + 1e-9, arguments.step):
        error = relative_error(float(waves))
        worst = max(worst, error)
        print(f"{waves:6.2f} waves{error:9.4%}", flush=True)
    print(f"{'worst':>12s}{worst:9.4%}")


if __name__ == "__main__":
    main()

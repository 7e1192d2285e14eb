"""Lommel's functions beside a Fourier transform: ``python -m benchmarks.experiments.lommel``.

Prints, for defocus from 0 to 20 waves, by how much the light around a point as
:func:`bokehnet.baselines.spread.lommel_functions.lommel_intensity` has it differs from that of a pupil that
is defocused by a phase and transformed, relative to the latter's L2 norm over the plane.
"""

import argparse
import math

import numpy as np

from bokehnet.baselines.spread.lommel_functions import lommel_intensity

__all__ = ["CELLS", "relative_error", "transformed_pupil"]

# Across the pupil's radius, and how many times wider the transform is.
CELLS, _PADDED = 1024, 8


def transformed_pupil(waves: float, cells: int = CELLS) -> tuple[np.ndarray, np.ndarray]:
    """Distances v up to twice the disc and intensity, by FFT of a defocused pupil: a cut through the middle.

    Rows of the pupil are added up first: the transform of the sums is the central row of the transform.

    Args:
        waves: Defocus at the pupil's edge.
        cells: Of the pupil along its radius.
    """
    at = (np.arange(-cells, cells) + 0.5) / cells
    rho2 = at[None, :] ** 2 + at[:, None] ** 2
    soft = np.clip((1 - np.sqrt(rho2)) * cells + 0.5, 0, 1)
    columns = (soft * np.exp(2j * math.pi * waves * rho2)).sum(axis=0)
    padded = np.zeros(2 * _PADDED * cells, complex)
    padded[: 2 * cells] = columns
    field = np.fft.fft(padded) / soft.sum()
    v = 2 * math.pi * cells * np.arange(len(padded)) / len(padded)
    wanted = v <= max(2 * 4 * math.pi * waves, 30)
    return v[wanted], np.abs(field[wanted]) ** 2


def relative_error(waves: float, cells: int = CELLS) -> float:
    """L2 norm of the difference over that of the light; a ring weighs by its circumference."""
    v, wanted = transformed_pupil(waves, cells)
    found = lommel_intensity(4 * math.pi * waves, v)
    return math.sqrt((v * (found - wanted) ** 2).sum() / (v * wanted**2).sum())


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--most", type=float, default=20.0, help="waves")
    parser.add_argument("--step", type=float, default=0.5, help="waves")
    arguments = parser.parse_args()
    worst = 0.0
    for waves in np.arange(0, arguments.most + 1e-9, arguments.step):
        error = relative_error(float(waves))
        worst = max(worst, error)
        print(f"{waves:6.2f} waves{error:9.4%}", flush=True)
    print(f"{'worst':>12s}{worst:9.4%}")


if __name__ == "__main__":
    main()

"""Tables of the scores of several engines on the same pictures."""

from collections.abc import Callable, Iterable

import numpy as np

from train.scores.evaluation_sets import Shot
from train.scores.metrics import compare, mean_scores

__all__ = ["COLUMNS", "Engine", "print_header", "print_scores", "score"]

COLUMNS = ("psnr", "ssim", "edge_psnr", "edge_ssim")

# Function (image, defocus, aperture=) -> picture; the rays also accept a seed.
Engine = Callable[..., np.ndarray]


# Scores of one shot by engine.
Row = dict[str, dict[str, float]]


def score(shots: Iterable[Shot], engines: dict[str, Engine]) -> list[Row]:
    """Return the scores of every engine on every shot, plus the noise of the truth where known."""
    return [
        {
            name: compare(engine(shot.image, shot.defocus, aperture=shot.aperture), shot.truth, shot.defocus)
            for name, engine in engines.items()
        }
        | ({} if shot.noise is None else {"truth's noise": shot.noise})
        for shot in shots
    ]


def print_header(label: str) -> None:
    """Print the header of the table; dB and [0, 1]."""
    print(f"{label:22s}{'engine':14s}" + "".join(f"{column:>11s}" for column in COLUMNS))


def print_scores(label: str, rows: list[Row]) -> None:
    """Print one line per engine: means over ``rows``."""
    for name in rows[0]:
        scores = mean_scores([row[name] for row in rows])
        values = "".join(f"{scores[column]:11.4f}" for column in COLUMNS)
        print(f"{label:22s}{name:14s}{values}", flush=True)

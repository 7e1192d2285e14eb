"""Scores of several engines on the same pictures, as a table."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from bokehnet.optics.aperture import Aperture
from train.metrics import compare, mean_scores

__all__ = ["COLUMNS", "Engine", "Shot", "print_header", "print_scores", "score"]

COLUMNS = ("psnr", "ssim", "edge_psnr", "edge_ssim")

# (image, defocus, aperture=) -> picture; the rays also take a seed
Engine = Callable[..., np.ndarray]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Shot:
    """A picture to render and the truth; scene-linear float32.

    Attributes:
        image: All in focus, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W).
        truth: With bokeh, (H, W, 3).
        aperture: Shape of the opening.
        noise: What :func:`train.metrics.compare` would say of an engine that errs by the noise of the
            truth alone, where that is known.
    """

    image: np.ndarray
    defocus: np.ndarray
    truth: np.ndarray
    aperture: Aperture = field(default_factory=Aperture)
    noise: dict[str, float] | None = None


# For each engine the scores of one shot.
Row = dict[str, dict[str, float]]


def score(shots: Iterable[Shot], engines: dict[str, Engine]) -> list[Row]:
    """Scores of every engine on every shot, and last the noise of the truth where it is known."""
    return [
        {
            name: compare(engine(shot.image, shot.defocus, aperture=shot.aperture), shot.truth, shot.defocus)
            for name, engine in engines.items()
        }
        | ({} if shot.noise is None else {"truth's noise": shot.noise})
        for shot in shots
    ]


def print_header(label: str) -> None:
    """The table's first line; dB and [0, 1]."""
    print(f"{label:22s}{'engine':14s}" + "".join(f"{column:>11s}" for column in COLUMNS))


def print_scores(label: str, rows: list[Row]) -> None:
    """One line for each engine: means over ``rows``."""
    for name in rows[0]:
        scores = mean_scores([row[name] for row in rows])
        values = "".join(f"{scores[column]:11.4f}" for column in COLUMNS)
        print(f"{label:22s}{name:14s}{values}", flush=True)

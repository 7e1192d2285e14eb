"""Log of a run: curves and pictures for TensorBoard, a progress bar and lines for the terminal.

With the environment variable ``WANDB_PROJECT``, curves and pictures also go to that project of Weights &
Biases, whose other variables (``WANDB_MODE=offline``, ``WANDB_API_KEY``, ...) apply.
"""

import hashlib
import os
from collections.abc import Iterable, Sequence
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from torch import Tensor
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

from bokehnet.errors import MissingExtraError

__all__ = ["Logbook", "over_held_out"]

_Example = TypeVar("_Example")


def _start_wandb(name: str, out: Path, first_step: int) -> Any:
    """Return the run in the project that ``WANDB_PROJECT`` names, or None without that variable.

    The folder of the run identifies it, so that a resumed run continues its curves.

    Raises:
        MissingExtraError: The package ``wandb`` is not installed.
    """
    if not os.environ.get("WANDB_PROJECT"):
        return None
    try:
        wandb = import_module("wandb")
    except ImportError as error:
        raise MissingExtraError(
            "WANDB_PROJECT: expected the package wandb; pip install wandb, or unset the variable"
        ) from error
    identity = hashlib.sha256(str(out.resolve()).encode()).hexdigest()[:16]
    resume = "allow" if first_step else None
    return wandb.init(name=f"{name} {out.name}", dir=str(out), id=identity, resume=resume)


class Logbook:
    """Log with curves, pictures, a progress bar and lines; a silent log writes nothing."""

    def __init__(self, name: str, out: Path, *, steps: int, first_step: int, silent: bool) -> None:
        # Hides entries that a killed run logged after the checkpoint from which this run resumes.
        self._writer = None if silent else SummaryWriter(out, purge_step=first_step + 1)
        self._wandb = None if silent else _start_wandb(name, out, first_step)
        self._bar = tqdm(total=steps, initial=first_step, desc=name, mininterval=1, disable=silent)

    def __enter__(self) -> "Logbook":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._bar.close()
        if self._writer is not None:
            self._writer.close()
        if self._wandb is not None:
            self._wandb.finish(exit_code=int(kind is not None))

    def advance(self) -> None:
        """Advance the progress bar by one step."""
        self._bar.update()

    def curves(self, values: dict[str, float], step: int) -> None:
        """Log one value per curve; the bar shows ``loss/sum``."""
        if self._writer is not None:
            for key, value in values.items():
                self._writer.add_scalar(key, value, step)
        if self._wandb is not None:
            self._wandb.log(values, step=step)
        self._bar.set_postfix(loss=f"{values['loss/sum']:.4f}", refresh=False)

    def validation(self, scores: dict[str, float], pictures: dict[str, Tensor], step: int) -> None:
        """Log scores, and pictures (3, H, W) in [0, 1]."""
        if self._writer is not None:
            for key, score in scores.items():
                self._writer.add_scalar(f"validation/{key}", score, step)
            for key, picture in pictures.items():
                self._writer.add_image(key, picture, step)
        if self._wandb is not None:
            image = import_module("wandb").Image
            drawn = {key: image(picture.movedim(0, -1).numpy()) for key, picture in pictures.items()}
            self._wandb.log({f"validation/{key}": score for key, score in scores.items()} | drawn, step=step)
        self.line(f"step {step}: " + "  ".join(f"{key} {score:.3f}" for key, score in scores.items()))

    def line(self, text: str) -> None:
        """Print a line above the bar."""
        if self._writer is not None:
            self._bar.write(text)


def over_held_out(examples: Sequence[_Example]) -> Iterable[_Example]:
    """Iterate over held-out examples with a separate progress bar below that of the training."""
    bar: Iterable[_Example] = tqdm(examples, desc="validating", leave=False, mininterval=1)
    return bar

"""Log of a run: curves and pictures for TensorBoard, a progress bar and lines for the terminal."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TypeVar

from torch import Tensor
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm

__all__ = ["Logbook", "over_held_out"]

_Example = TypeVar("_Example")


class Logbook:
    """Log with curves, pictures, a progress bar and lines; a silent log writes nothing."""

    def __init__(self, name: str, out: Path, *, steps: int, first_step: int, silent: bool) -> None:
        # Hides entries that a killed run logged after the checkpoint from which this run resumes.
        self._writer = None if silent else SummaryWriter(out, purge_step=first_step + 1)
        self._bar = tqdm(total=steps, initial=first_step, desc=name, mininterval=1, disable=silent)

    def __enter__(self) -> "Logbook":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._bar.close()
        if self._writer is not None:
            self._writer.close()

    def advance(self) -> None:
        """Advance the progress bar by one step."""
        self._bar.update()

    def curves(self, values: dict[str, float], step: int) -> None:
        """Log one value per curve; the bar shows ``loss/sum``."""
        if self._writer is not None:
            for key, value in values.items():
                self._writer.add_scalar(key, value, step)
        self._bar.set_postfix(loss=f"{values['loss/sum']:.4f}", refresh=False)

    def validation(self, scores: dict[str, float], pictures: dict[str, Tensor], step: int) -> None:
        """Log scores, and pictures (3, H, W) in [0, 1]."""
        if self._writer is not None:
            for key, score in scores.items():
                self._writer.add_scalar(f"validation/{key}", score, step)
            for key, picture in pictures.items():
                self._writer.add_image(key, picture, step)
        self.line(f"step {step}: " + "  ".join(f"{key} {score:.3f}" for key, score in scores.items()))

    def line(self, text: str) -> None:
        """Print a line above the bar."""
        if self._writer is not None:
            self._bar.write(text)


def over_held_out(examples: Sequence[_Example]) -> Iterable[_Example]:
    """Iterate over held-out examples with a separate progress bar below that of the training."""
    bar: Iterable[_Example] = tqdm(examples, desc="validating", leave=False, mininterval=1)
    return bar

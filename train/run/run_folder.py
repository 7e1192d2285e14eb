"""Files of a run on disk, so that it can resume after a kill at any step."""

import shutil
import sys
import time
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from bokehnet.config import build_config, check_same, dump_json, to_dict
from bokehnet.errors import DataFileError
from bokehnet.io.files.atomic import remove_leftovers, write_atomic, write_text
from bokehnet.models.checkpoint import load_checkpoint, save_checkpoint
from train.run.schedule import OptimConfig

__all__ = ["RunFolder"]


# Keys, besides the weights, that a checkpoint needs to resume a run.
_RESUME_KEYS = {"run", "raw", "optimizer", "step"}


class RunFolder:
    """Folder of a run: ``config.json`` and the checkpoint ``last.pt``, saved every few steps or minutes.

    Also holds the checkpoint before the last one, ``previous.pt``, and a batch whose gradient was not finite,
    as ``bad_batch-0.pt``.

    Attributes:
        checkpoint: Path of the checkpoint.
    """

    def __init__(self, path: Path, name: str, config: Any) -> None:
        self.checkpoint, self._previous = path / "last.pt", path / "previous.pt"
        self.path, self.name, self.config = path, name, config
        self._saved_at = time.monotonic()

    def prepare(self) -> None:
        """Create the folder and remove leftovers; no other process may write there now."""
        self.path.mkdir(parents=True, exist_ok=True)
        remove_leftovers(self.path)

    def load(self) -> dict[str, Any] | None:
        """Return the checkpoint of an earlier start of this run, or ``None`` without one.

        A damaged checkpoint is reported on stderr, and the one before it is used.

        Raises:
            DataFileError: No checkpoint can be resumed.
            ConfigError: It has another configuration; keys that it lacks count as defaults.
        """
        state = self._load_newest()
        if state is None:
            return None
        if state["name"] != self.name or _RESUME_KEYS - state.keys():
            raise DataFileError(
                f"{self.checkpoint}: expected a run of {self.name} to resume, found weights of "
                f"{state['name']}; choose another --out"
            )
        old = build_config(state["run"], type(self.config), str(self.checkpoint))
        check_same(f"{self.path}: holds a run", to_dict(old), to_dict(self.config), "choose another --out")
        return state

    def _load_newest(self) -> dict[str, Any] | None:
        if not self.checkpoint.exists():
            return load_checkpoint(self._previous) if self._previous.exists() else None
        try:
            return load_checkpoint(self.checkpoint)
        except DataFileError as error:
            if not self._previous.exists():
                raise
            state = load_checkpoint(self._previous)
            text = " ".join(str(error).split())
            print(f"warning: {text}; resuming from {self._previous.name}", file=sys.stderr)
            return state

    def write_config(self) -> None:
        """Write the resolved configuration."""
        write_text(self.path / "config.json", dump_json(self.config), error=DataFileError)

    def save_bad_batch(self, step: int, rank: int, batch: dict[str, Tensor], weights: dict[str, Any]) -> str:
        """Write the weights and the batch, or process ``rank``'s share, whose gradient was not finite.

        Returns:
            Name of the file, which replaces one of an earlier step.
        """
        path = self.path / f"bad_batch-{rank}.pt"
        content = {"step": step, "batch": batch, "raw": weights}
        write_atomic(path, lambda temporary: torch.save(content, temporary), error=DataFileError)
        return path.name

    def due(self, step: int) -> bool:
        """Return whether a checkpoint is due after ``step`` steps."""
        optim: OptimConfig = self.config.optim
        expired = time.monotonic() - self._saved_at > 60 * optim.checkpoint_minutes
        return expired or step % optim.checkpoint_every == 0 or step == optim.steps

    def save(self, state: dict[str, Any]) -> None:
        """Write the checkpoint; the one before it stays as ``previous.pt``."""
        if self.checkpoint.exists():
            self._previous.unlink(missing_ok=True)
            try:  # a second name of the same file, so that there is a checkpoint at any time
                self._previous.hardlink_to(self.checkpoint)
            except OSError:  # a disk without hard links
                shutil.copyfile(self.checkpoint, self._previous)
        save_checkpoint(self.checkpoint, self.name, self.config.model, {**state, "run": to_dict(self.config)})
        self._saved_at = time.monotonic()

"""Progress of a recipe on disk, and the plan of the remaining steps."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bokehnet.errors import ConfigError, DataFileError
from bokehnet.io.files.atomic import write_text
from train.recipe_steps.plan import Recipe, Step
from train.recipe_steps.queue import expected_seconds

__all__ = ["Progress", "time_in_words"]

# Interval at which the time of running steps is written to disk, seconds; a killed start loses no more.
_SAVE_INTERVAL_S = 20.0


def time_in_words(seconds: float) -> str:
    """Return a time as text in hours, minutes or seconds."""
    for unit, size in (("h", 3600), ("min", 60)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"


class Progress:
    """Progress of a recipe, stored in ``recipe.json``.

    Args:
        recipe: Recipe with all steps.
        out: Folder of all outputs.
        clock: Function that returns the time in seconds.

    Attributes:
        elapsed: Total time of all starts up to the last save, seconds.

    Raises:
        DataFileError: The file exists and is not the progress of a recipe.
    """

    def __init__(self, recipe: Recipe, out: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self.recipe, self.out = recipe, out
        self._path = out / "recipe.json"
        self._entries: dict[str, dict[str, Any]] = {}
        self._running: set[str] = set()
        self._clock = clock
        self.elapsed, self._saved_at = 0.0, clock()
        if self._path.exists():
            try:
                content = json.loads(self._path.read_text(encoding="utf-8"))
                self._entries = {makes: {**entry} for makes, entry in content["steps"].items()}
                self.elapsed = float(content.get("seconds", 0.0))
            except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
                raise DataFileError(
                    f"{self._path}: expected the progress of a recipe ({error}); choose another --out"
                ) from error

    def seconds(self, step: Step) -> float:
        """Return the time of a step over all starts, seconds."""
        return float(self._entries.get(step.makes, {}).get("seconds", 0.0))

    def done(self, step: Step) -> bool:
        """Return whether a step is done with its present definition."""
        entry = self._entries.get(step.makes, {})
        unchanged = entry.get("asked") == self.recipe.fingerprint(step)
        return bool(entry.get("done") and unchanged and self._path_of(step).exists())

    def check(self, step: Step) -> None:
        """Raise unless a step can resume from its existing output.

        Raises:
            ConfigError: Its inputs have changed since. The step's own tool checks the step's settings.
        """
        entry, recipe = self._entries.get(step.makes), self.recipe
        if entry is None or step.overwrites or not self._path_of(step).exists():
            return
        same_settings = entry.get("own") == recipe.fingerprint(step, with_needs=False)
        if same_settings and entry.get("asked") != recipe.fingerprint(step):
            raise ConfigError(
                f"{self._path_of(step)}: was made from outputs of earlier steps, whose definition has "
                "changed; remove it or choose another --out"
            )

    def _path_of(self, step: Step) -> Path:
        return self.out / step.makes.removeprefix("bokehnet/")

    def state(self, step: Step) -> str:
        """Return the state of a step as text."""
        if self.done(step):
            return f"done in {time_in_words(self.seconds(step))}"
        return f"begun, {time_in_words(self.seconds(step))} so far" if self.seconds(step) else "to do"

    def plan(self) -> str:
        """Return a table of all steps with their expected times and states."""
        steps = self.recipe.steps
        times = [time_in_words(self.recipe.seconds(step)) for step in steps]
        rows = [
            [step.makes, step.by, seconds, self.state(step)]
            for step, seconds in zip(steps, times, strict=True)
        ]
        widths = [max(len(row[i]) for row in rows) for i in range(3)]
        lines = ["  ".join([*map(str.ljust, row[:3], widths), row[3]]) for row in rows]
        remaining = [step for step in steps if not self.done(step)]
        total_time, remaining_time = (
            time_in_words(expected_seconds(self.recipe, part)) for part in (steps, remaining)
        )
        elapsed = time_in_words(self.elapsed)
        lines.append(
            f"expected: {total_time} in all (cores: {self.recipe.workers}), "
            f"{remaining_time} of it to do; elapsed: {elapsed}"
        )
        return "\n".join(lines)

    def begin(self, step: Step) -> None:
        """Record that a step has started."""
        self._count()
        definition, own_fingerprint = (
            self.recipe.fingerprint(step, with_needs=needs) for needs in (True, False)
        )
        self._entries[step.makes] = {
            "asked": definition,
            "own": own_fingerprint,
            "done": False,
            "seconds": self.seconds(step),
        }
        self._running.add(step.makes)
        self._write()

    def save_periodically(self) -> None:
        """Save the time of the running steps at intervals."""
        if self._clock() - self._saved_at >= _SAVE_INTERVAL_S:
            self._count()
            self._write()

    def end(self, step: Step, done: bool) -> None:
        """Record that a step has ended, and whether it succeeded."""
        self._count()
        self._running.remove(step.makes)
        self._entries[step.makes]["done"] = done
        self._write()

    def _count(self) -> None:
        """Add the time since the last call to the total and to each running step."""
        now = self._clock()
        passed, self._saved_at = now - self._saved_at, now
        self.elapsed += passed
        for makes in self._running:
            self._entries[makes]["seconds"] += passed

    def _write(self) -> None:
        text = json.dumps({"seconds": self.elapsed, "steps": self._entries}, indent=1)
        write_text(self._path, text + "\n", error=DataFileError)

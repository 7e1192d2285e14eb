"""What has been done of a recipe, and the plan of what is left."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bokehnet.errors import ConfigError, DataFileError
from bokehnet.io.atomic import write_text
from train.recipe_plan import Recipe, Step
from train.recipe_queue import expected_seconds

__all__ = ["Progress", "time_in_words"]

# Seconds after which the time that running steps have taken is written down: a killed start loses no more.
_NOTE_EVERY = 20.0


def time_in_words(seconds: float) -> str:
    """A time in words, in the unit that suits it."""
    for unit, size in (("h", 3600), ("min", 60)):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"


class Progress:
    """What has been done of a recipe, kept in ``recipe.json``.

    Args:
        recipe: The steps.
        out: Folder in which everything is made.
        clock: Tells the time in seconds.

    Attributes:
        taken: Time in seconds of all starts, up to what was noted last.

    Raises:
        DataFileError: The file is there and is none of ours.
    """

    def __init__(self, recipe: Recipe, out: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self.recipe, self.out = recipe, out
        self._path = out / "recipe.json"
        self._told: dict[str, dict[str, Any]] = {}
        self._running: set[str] = set()
        self._clock = clock
        self.taken, self._noted = 0.0, clock()
        if self._path.exists():
            try:
                there = json.loads(self._path.read_text(encoding="utf-8"))
                self._told = {makes: {**told} for makes, told in there["steps"].items()}
                self.taken = float(there.get("seconds", 0.0))
            except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
                raise DataFileError(
                    f"{self._path}: expected what was done of a recipe ({error}); choose another --out"
                ) from error

    def seconds(self, step: Step) -> float:
        """Time that a step has taken in all starts."""
        return float(self._told.get(step.makes, {}).get("seconds", 0.0))

    def done(self, step: Step) -> bool:
        """Whether a step is done as it is asked for now."""
        told = self._told.get(step.makes, {})
        same = told.get("asked") == self.recipe.fingerprint(step)
        return bool(told.get("done") and same and self._path_of(step).exists())

    def check(self, step: Step) -> None:
        """Raise unless a step can go on with what it has begun.

        Raises:
            ConfigError: That was made of what is no more; what else has changed its tool tells by itself.
        """
        told, recipe = self._told.get(step.makes), self.recipe
        if told is None or step.overwrites or not self._path_of(step).exists():
            return
        alike = told.get("own") == recipe.fingerprint(step, with_needs=False)
        if alike and told.get("asked") != recipe.fingerprint(step):
            raise ConfigError(
                f"{self._path_of(step)}: was made of what steps before it made, and these are asked for "
                "otherwise now; remove it or choose another --out"
            )

    def _path_of(self, step: Step) -> Path:
        return self.out / step.makes.removeprefix("bokehnet/")

    def state(self, step: Step) -> str:
        """The same in words."""
        if self.done(step):
            return f"done in {time_in_words(self.seconds(step))}"
        return f"begun, {time_in_words(self.seconds(step))} so far" if self.seconds(step) else "to do"

    def plan(self) -> str:
        """All steps with their expected hours and states, as a table."""
        steps = self.recipe.steps
        times = [time_in_words(self.recipe.seconds(step)) for step in steps]
        rows = [
            [step.makes, step.by, seconds, self.state(step)]
            for step, seconds in zip(steps, times, strict=True)
        ]
        widths = [max(len(row[i]) for row in rows) for i in range(3)]
        lines = ["  ".join([*map(str.ljust, row[:3], widths), row[3]]) for row in rows]
        left = [step for step in steps if not self.done(step)]
        whole, rest = (time_in_words(expected_seconds(self.recipe, part)) for part in (steps, left))
        taken = time_in_words(self.taken)
        lines.append(
            f"expected: {whole} in all (cores: {self.recipe.workers}), {rest} of it to do; taken: {taken}"
        )
        return "\n".join(lines)

    def begin(self, step: Step) -> None:
        """Note that a step is begun."""
        self._count()
        asked, own = (self.recipe.fingerprint(step, with_needs=needs) for needs in (True, False))
        self._told[step.makes] = {"asked": asked, "own": own, "done": False, "seconds": self.seconds(step)}
        self._running.add(step.makes)
        self._write()

    def go_on(self) -> None:
        """Note from time to time how long the steps that run have taken."""
        if self._clock() - self._noted >= _NOTE_EVERY:
            self._count()
            self._write()

    def end(self, step: Step, done: bool) -> None:
        """Note that a step that was begun has come to an end, and whether it is done."""
        self._count()
        self._running.remove(step.makes)
        self._told[step.makes]["done"] = done
        self._write()

    def _count(self) -> None:
        """Count the time that has passed, for all and for each step that runs."""
        now = self._clock()
        passed, self._noted = now - self._noted, now
        self.taken += passed
        for makes in self._running:
            self._told[makes]["seconds"] += passed

    def _write(self) -> None:
        text = json.dumps({"seconds": self.taken, "steps": self._told}, indent=1)
        write_text(self._path, text + "\n", error=DataFileError)

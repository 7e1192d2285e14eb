"""Queue of recipe steps that run in parallel, and the expected total time."""

from collections.abc import Sequence

from train.recipe_steps.plan import Recipe, Step

__all__ = ["Queue", "expected_seconds"]


class Queue:
    """Queue of the steps that wait for a free core and for their inputs, in the order of the recipe.

    A tool that splits its work among processes takes all cores that are free when it starts; every other tool
    takes one core.

    Args:
        recipe: All steps.
        left: Steps still to do, in the same order.
        cores: Number of cores.
    """

    def __init__(self, recipe: Recipe, left: Sequence[Step], cores: int) -> None:
        self._left, self.free = list(left), cores
        self._needs = {step.makes: {need.makes for need in recipe.needs(step)} for step in left}
        self._missing = {step.makes for step in left}

    def take(self) -> tuple[Step, int] | None:
        """Return the next step that can start and its number of cores, or ``None`` if all must wait."""
        for step in self._left if self.free else ():
            if not self._needs[step.makes] & self._missing:
                self._left.remove(step)
                cores = self.free if step.shared else 1
                self.free -= cores
                return step, cores
        return None

    def give_back(self, step: Step, cores: int) -> None:
        """Mark a step as done and free its cores."""
        self._missing.discard(step.makes)
        self.free += cores


def expected_seconds(recipe: Recipe, left: Sequence[Step]) -> float:
    """Return the expected time in seconds for these steps in parallel on the recipe's cores."""
    queue, now = Queue(recipe, left, recipe.workers), 0.0
    running: list[tuple[float, Step, int]] = []
    while True:
        while (started := queue.take()) is not None:
            step, cores = started
            running.append((now + recipe.work(step) / cores, step, cores))
        if not running:
            return now
        ended = min(running, key=lambda job: job[0])
        running.remove(ended)
        now = ended[0]
        queue.give_back(*ended[1:])

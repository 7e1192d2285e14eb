"""Which steps of a recipe run side by side, and how long all of them take that way."""

from collections.abc import Sequence

from train.recipe_plan import Recipe, Step

__all__ = ["Queue", "expected_seconds"]


class Queue:
    """Steps that wait for a free core and for what they need, in the order of the recipe.

    A tool that shares its work among processes takes all cores that are free when it starts, every other one
    core.

    Args:
        recipe: All steps.
        left: Those that are to be done, in its order.
        cores: How many there are.
    """

    def __init__(self, recipe: Recipe, left: Sequence[Step], cores: int) -> None:
        self._left, self.free = list(left), cores
        self._needs = {step.makes: {need.makes for need in recipe.needs(step)} for step in left}
        self._missing = {step.makes for step in left}

    def take(self) -> tuple[Step, int] | None:
        """The next step that can start now, with its number of cores; none if all have to wait."""
        for step in self._left if self.free else ():
            if not self._needs[step.makes] & self._missing:
                self._left.remove(step)
                cores = self.free if step.shared else 1
                self.free -= cores
                return step, cores
        return None

    def give_back(self, step: Step, cores: int) -> None:
        """A step is done; its cores are free again."""
        self._missing.discard(step.makes)
        self.free += cores


def expected_seconds(recipe: Recipe, left: Sequence[Step]) -> float:
    """Expected time until all of these steps are done, side by side on the recipe's cores."""
    queue, now = Queue(recipe, left, recipe.workers), 0.0
    running: list[tuple[float, Step, int]] = []
    while True:
        while (taken := queue.take()) is not None:
            step, cores = taken
            running.append((now + recipe.work(step) / cores, step, cores))
        if not running:
            return now
        ended = min(running, key=lambda job: job[0])
        running.remove(ended)
        now = ended[0]
        queue.give_back(*ended[1:])

"""History of the studio: states to which undo and redo return."""

from collections import deque
from dataclasses import dataclass
from time import monotonic
from typing import Any

from bokehnet.settings.settings import RenderSettings
from bokehnet.studio.strokes import Stroke

__all__ = ["History", "State"]

_MAX_STEPS = 200  # number of steps that can be undone
_MAX_DRAG_PAUSE = 0.8  # s between two values of one control that count as one step


@dataclass(frozen=True, kw_only=True, slots=True)
class State:
    """Settings, strokes and preset of a session."""

    settings: RenderSettings
    strokes: tuple[Stroke, ...]
    preset: str


class History:
    """States before and after the present one; the session holds its lock during every call."""

    def __init__(self) -> None:
        # Each state has the words for the change between it and its neighbour towards the present.
        self._done: deque[tuple[State, str]] = deque(maxlen=_MAX_STEPS)
        self._undone: list[tuple[State, str]] = []
        self._last_change: tuple[Any, float] = (None, 0.0)

    @property
    def summary(self) -> dict[str, Any]:
        """Number of changes that can be undone and redone, and the words of all, oldest first."""
        changes = [change for _, change in (*self._done, *reversed(self._undone))]
        return {"done": len(self._done), "undone": len(self._undone), "changes": changes}

    def clear(self) -> None:
        """Forget all states."""
        self._done.clear()
        self._undone.clear()

    def remember(self, present: State, change: str, control: Any = None) -> None:
        """Add the present state before a change; quick values of one control are one step.

        Args:
            present: State before the change.
            change: Words for the change.
            control: Changed control; None for a change that is always a step of its own.
        """
        (last, then), now = self._last_change, monotonic()
        self._last_change = control, now
        self._undone.clear()
        if control is None or control != last or now - then > _MAX_DRAG_PAUSE or not self._done:
            self._done.append((present, change))

    def step(self, present: State, back: bool, count: int = 1) -> State:
        """Return the state some changes before the present one, or after it.

        Args:
            present: State at present.
            back: True to undo.
            count: Number of changes; those that do not exist are ignored.
        """
        source, target = (self._done, self._undone) if back else (self._undone, self._done)
        for _ in range(min(count, len(source))):
            state, change = source.pop()
            target.append((present, change))
            present, self._last_change = state, (None, 0.0)
        return present

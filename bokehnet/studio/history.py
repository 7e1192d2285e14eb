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
        self._done: deque[State] = deque(maxlen=_MAX_STEPS)
        self._undone: list[State] = []
        self._last_change: tuple[Any, float] = (None, 0.0)

    @property
    def counts(self) -> dict[str, int]:
        """Number of steps that can be undone, and of those that can be redone."""
        return {"done": len(self._done), "undone": len(self._undone)}

    def clear(self) -> None:
        """Forget all states."""
        self._done.clear()
        self._undone.clear()

    def remember(self, present: State, control: Any = None) -> None:
        """Add the present state before a change; quick values of one control are one step.

        Args:
            present: State before the change.
            control: Changed control; None for a change that is always a step of its own.
        """
        (last, then), now = self._last_change, monotonic()
        self._last_change = control, now
        self._undone.clear()
        if control is None or control != last or now - then > _MAX_DRAG_PAUSE or not self._done:
            self._done.append(present)

    def step(self, present: State, back: bool) -> State | None:
        """Return the state before the present one, or the one after it; None if there is none."""
        source, target = (self._done, self._undone) if back else (self._undone, self._done)
        if not source:
            return None
        target.append(present)
        self._last_change = None, 0.0
        return source.pop()

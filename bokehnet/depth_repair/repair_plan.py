"""What the repair of maps decides once for all frames of a shot."""

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["RepairPlan", "common_plan"]


@dataclass(frozen=True, kw_only=True, slots=True)
class RepairPlan:
    """What the repair decides from a map, so that it may be decided once for all maps of a shot.

    Attributes:
        repaired: Whether edges are moved.
        softness: Share of soft steps.
        shift: Pixels by which near things grow everywhere.
        offset: Pixels down and to the right by which the map is moved.
        noise: Deviation of the map's noise, as a share of its range.
    """

    repaired: bool
    softness: float
    shift: int
    offset: tuple[int, int] = (0, 0)
    noise: float = 0.0


def common_plan(plans: Sequence[RepairPlan]) -> RepairPlan:
    """What most of some maps of a shot ask for: medians, of an even number the lower one.

    Examples:
        >>> common_plan([RepairPlan(repaired=x > 1, softness=0.1 * x, shift=x) for x in (0, 2, 5)])
        RepairPlan(repaired=True, softness=0.2, shift=2, offset=(0, 0), noise=0.0)
    """
    middle = (len(plans) - 1) // 2
    down, right = (sorted(plan.offset[axis] for plan in plans)[middle] for axis in (0, 1))
    return RepairPlan(
        repaired=sorted(plan.repaired for plan in plans)[middle],
        softness=sorted(plan.softness for plan in plans)[middle],
        shift=sorted(plan.shift for plan in plans)[middle],
        offset=(down, right),
        noise=sorted(plan.noise for plan in plans)[middle],
    )

"""Decisions of the repair that all frames of a shot share, so that edges do not flicker."""

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["RepairPlan", "common_plan"]


@dataclass(frozen=True, kw_only=True, slots=True)
class RepairPlan:
    """Decisions of the repair for one map, or for all maps of a shot.

    Attributes:
        repaired: True if edges are moved.
        softness: Fraction of soft edges, 0 to 1.
        shift: Edge bias: pixels by which foreground regions grow everywhere, negative to shrink.
        offset: Translation of the map down and to the right, pixels.
        noise: Standard deviation of the noise, as a fraction of the range of the map; None if each map of the
            shot has its own.
        local_shift: Edge bias that is tried as well, pixels, and accepted in each place where the picture
            agrees better; 0 if the edges are off everywhere or nowhere.
        thin_fraction: Fraction of thin structures; maps without any may have lost them.
        wrong_pixels: Fraction of wrong single pixels that are corrected, 0 for none.
    """

    repaired: bool
    softness: float
    shift: int
    offset: tuple[int, int] = (0, 0)
    noise: float | None = 0.0
    local_shift: int = 0
    thin_fraction: float = 1.0
    wrong_pixels: float = 0.0


def common_plan(plans: Sequence[RepairPlan]) -> RepairPlan:
    """Return the median of the decisions for some maps of a shot; the lower one of an even number.

    Examples:
        >>> plan = common_plan([RepairPlan(repaired=x > 1, softness=0.1 * x, shift=x) for x in (0, 2, 5)])
        >>> plan.repaired, plan.softness, plan.shift
        (True, 0.2, 2)
    """
    middle = (len(plans) - 1) // 2
    down, right = (sorted(plan.offset[axis] for plan in plans)[middle] for axis in (0, 1))
    return RepairPlan(
        repaired=sorted(plan.repaired for plan in plans)[middle],
        softness=sorted(plan.softness for plan in plans)[middle],
        shift=sorted(plan.shift for plan in plans)[middle],
        offset=(down, right),
        noise=sorted(plan.noise or 0.0 for plan in plans)[middle],
        local_shift=sorted(plan.local_shift for plan in plans)[middle],
        thin_fraction=sorted(plan.thin_fraction for plan in plans)[middle],
        wrong_pixels=sorted(plan.wrong_pixels for plan in plans)[middle],
    )

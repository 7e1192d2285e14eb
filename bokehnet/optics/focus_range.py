"""A range of depths that stays sharp, which no lens can do: blur that grows from both of its ends."""

from bokehnet.checks import Array, array_namespace

__all__ = ["defocus_outside_range"]


def defocus_outside_range(focused_near: Array, focused_far: Array) -> Array:
    """Defocus of a picture that is sharp from a near to a far end: ``max(near, 0) + min(far, 0)``.

    What lies in front of the near end is blurred as by the lens focused there, what lies behind the far end
    as by the lens focused there, and what lies between not at all. Defocus rises with disparity, so that at
    most one term differs from 0, and both are 0 at their end: blur is continuous. With both ends in one
    place it is the defocus of that focus.

    Args:
        focused_near: Signed radius in pixels with the focus at the near end, any shape, array or tensor.
        focused_far: The same with the focus at the far end.

    Returns:
        Signed radius in pixels, positive in front of the range.
    """
    xp = array_namespace(focused_near)
    return xp.clip(focused_near, 0, None) + xp.clip(focused_far, None, 0)

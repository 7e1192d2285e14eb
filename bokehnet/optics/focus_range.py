"""Focus range: all depths in it are sharp (no lens does this), and blur grows from both of its ends."""

from bokehnet.checks import Array, array_namespace

__all__ = ["defocus_outside_range"]


def defocus_outside_range(focused_near: Array, focused_far: Array) -> Array:
    """Return the defocus of a picture that is sharp from a near to a far end: ``max(near, 0) + min(far, 0)``.

    Points in front of the near end are blurred as by a lens focused at the near end, points behind the far
    end as by a lens focused at the far end, and points between are sharp. Defocus increases with disparity,
    so at most one term differs from 0, and each is 0 at its end: blur is continuous. If both ends coincide,
    the result is the defocus of that focus.

    Args:
        focused_near: Signed blur radius with focus at the near end, pixels, any shape, array or tensor.
        focused_far: Signed blur radius with focus at the far end, pixels, the same shape.

    Returns:
        Signed blur radius, pixels, positive in front of the range.
    """
    xp = array_namespace(focused_near)
    return xp.clip(focused_near, 0, None) + xp.clip(focused_far, None, 0)

"""Circle of confusion: the blur radius of a point off the focal plane.

The signed radius is linear in inverse depth, so one formula serves relative disparity, metric depth and lens
data. The functions use operators only: they accept floats, NumPy arrays, torch tensors (with autograd) and
numba arguments.
"""

from numba.extending import register_jitable

from bokehnet.checks import Arithmetic, Array, Values, array_namespace

__all__ = ["coc_radius", "defocus_from_disparity", "defocus_outside_range", "disparity_from_depth"]


@register_jitable
def coc_radius(
    disparity: Values, focus_disparity: Array, pupil_radius: float, sensor_distance: float
) -> Values:
    """Return the signed circle-of-confusion radius on the sensor, mm; positive in front of focus.

    Args:
        disparity: Inverse depth of the point, 1/mm; 0 is infinitely far.
        focus_disparity: Inverse of the focus distance, 1/mm.
        pupil_radius: Radius of the entrance pupil, mm.
        sensor_distance: Distance from the rear principal plane to the sensor, mm.

    Source:
        Potmesil and Chakravarty, "A lens and aperture camera model for synthetic image generation",
        SIGGRAPH 1981; rewritten to be linear in disparity.
    """
    radius: Values = pupil_radius * sensor_distance * (disparity - focus_disparity)
    return radius


@register_jitable
def defocus_from_disparity(disparity: Values, blur: Arithmetic, focus_disparity: Arithmetic) -> Values:
    """Return the signed blur radius in pixels: ``blur * (disparity - focus_disparity)``.

    Args:
        disparity: Relative disparity in [0, 1], large for near points.
        blur: Blur radius of a point one unit of disparity away from focus, pixels.
        focus_disparity: Disparity in focus.

    Returns:
        Signed blur radius, pixels, positive in front of focus.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022. The formula is
        :func:`coc_radius` with ``blur = pupil_radius * sensor_distance / pixel_pitch``.
    """
    defocus: Values = blur * (disparity - focus_disparity)
    return defocus


def disparity_from_depth(depth: Values) -> Values:
    """Return the inverse of ``depth``; infinite depth (sky) gives exactly 0.

    Args:
        depth: Distance along the optical axis, positive, any shape and unit, NumPy array or tensor.
    """
    disparity: Values = 1.0 / depth
    return disparity


def defocus_outside_range(focused_near: Array, focused_far: Array) -> Array:
    """Return the defocus of a picture that is sharp from a near to a far end: ``max(near, 0) + min(far, 0)``.

    No lens does this. Points in front of the near end are blurred as by a lens focused at the near end,
    points behind the far end as by a lens focused at the far end, and points between are sharp. Defocus
    increases with disparity, so at most one term differs from 0, and each is 0 at its end: blur is
    continuous. If both ends coincide, the result is the defocus of that focus.

    Args:
        focused_near: Signed blur radius with focus at the near end, pixels, any shape, array or tensor.
        focused_far: Signed blur radius with focus at the far end, pixels, the same shape.

    Returns:
        Signed blur radius, pixels, positive in front of the range.
    """
    xp = array_namespace(focused_near)
    return xp.clip(focused_near, 0, None) + xp.clip(focused_far, None, 0)

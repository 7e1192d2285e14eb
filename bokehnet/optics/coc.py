"""The circle of confusion: how large a point off the focal plane becomes on the sensor.

Behind a lens the signed radius is linear in inverse depth, so one formula serves relative disparity,
metric depth and lens data. Operators only: floats, NumPy arrays, torch tensors (with autograd), numba.
"""

from numba.extending import register_jitable

from bokehnet.checks import Arithmetic, Array, Values

__all__ = ["coc_radius", "defocus_from_disparity", "disparity_from_depth"]


@register_jitable
def coc_radius(
    disparity: Values, focus_disparity: Array, pupil_radius: float, sensor_distance: float
) -> Values:
    """Signed circle-of-confusion radius on the sensor, mm; positive in front of focus.

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
    """Signed blur radius in pixels, positive in front of focus: ``blur * (disparity - focus_disparity)``.

    Args:
        disparity: Relative disparity in [0, 1], near is large.
        blur: Radius in pixels of a point one unit of disparity away from focus.
        focus_disparity: The disparity that stays sharp.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022. It is
        :func:`coc_radius` with ``blur = pupil_radius * sensor_distance / pixel_pitch``.
    """
    defocus: Values = blur * (disparity - focus_disparity)
    return defocus


def disparity_from_depth(depth: Values) -> Values:
    """Return the inverse of ``depth``, 1/unit; infinite depth (sky) gives exactly 0.

    Args:
        depth: Distance along the optical axis, positive, any shape, NumPy array or tensor.
    """
    disparity: Values = 1.0 / depth
    return disparity

"""Mappings of thesis 002, 5.2.2, against the thin lens."""

import pytest

from bokehnet.lenses import ThinLens
from bokehnet.lenses.lookup.printed_mappings import circle_of_confusion, equivalent_focus, image_distance


def test_5_5_and_5_7_are_the_thin_lens():
    lens = ThinLens(focal_length=50.0, f_number=2.0, focus_distance=1500.0)
    assert image_distance(1500.0, 50.0) == pytest.approx(lens.sensor_distance)
    for distance in (800.0, 1500.0, 6000.0):
        printed = circle_of_confusion(distance, 1500.0, 50.0, lens.pupil_radius)
        assert printed == pytest.approx(-float(lens.coc_radius(1 / distance)))


def test_5_6_and_5_9_are_solved():
    focal, radius, reference = 50.0, 12.5, 60.0
    for distance in (500.0, 2000.0, 9000.0):
        for at in (None, 50.6):
            focus = equivalent_focus(distance, 1500.0, reference, focal, radius, at)
            expected = circle_of_confusion(distance, 1500.0, at or focal, radius)
            assert circle_of_confusion(reference, focus, focal, radius) == pytest.approx(expected)


def test_5_8_has_no_axial_colour_in_focus():
    """Authority: two thin lenses of 50 and 50.6 mm on one sensor."""
    focus, radius = 1500.0, 12.5
    assert circle_of_confusion(focus, focus, 50.6, radius) == 0
    sensor, image = image_distance(focus, 50.0), image_distance(focus, 50.6)
    assert abs(radius * (sensor / image - 1)) > 0.1  # mm

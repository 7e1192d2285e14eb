"""The drawing of a lens: that it is there, and that its spots are right."""

import numpy as np
import pytest

from bokehnet.io.image import read_image
from bokehnet.lenses import load_lens
from bokehnet.lenses.reports.plot import plot_lens, spot

pytest.importorskip("matplotlib")


@pytest.mark.parametrize(("name", "focus"), [("retrofocus", 1500.0), ("biconvex", float("inf"))])
def test_a_picture_is_drawn(tmp_path, name, focus):
    path = tmp_path / "lens.png"
    plot_lens(load_lens(name, focus_distance=focus)).savefig(path, dpi=130)
    picture = np.asarray(read_image(path))
    assert picture.shape == (1170, 1560, 3)
    assert picture.std() > 0.1


def test_spots_of_a_singlet_show_its_spherical_aberration():
    """Born and Wolf, 5.5: the size grows with the cube of the aperture."""
    sizes = [np.abs(spot(load_lens("biconvex", f_number=n), 0.0, 587.6)).max() for n in (16.0, 8.0)]
    assert sizes[1] / sizes[0] == pytest.approx(8, rel=0.15)


def test_the_rms_of_a_spot_is_that_of_the_evenly_lit_pupil():
    """Formula: an evenly lit disc of radius R has the rms radius R / sqrt 2, whatever the number of rings."""
    lens = load_lens("biconvex", f_number=90.0, focusing="paraxial")
    vars(lens)["focus_shift"] = 2.0  # a sensor far behind the focus
    for rings in (3, 16, 40):
        points = spot(lens, 0.0, 587.5618, rings=rings)
        radius = 2.0 * lens.paraxial.exit.radius / (lens.gaussian_focus - lens.paraxial.exit.position)
        reached = np.sqrt((points**2).sum(1).mean())
        passed = len(points) / (3 * rings * (rings + 1))  # of the pupil aimed at, 1.5 times as wide
        assert reached == pytest.approx(abs(radius) * 1.5 * np.sqrt(passed / 2), rel=0.02)

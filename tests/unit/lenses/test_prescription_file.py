"""Lens files: what may stand in them, and what is said when it is wrong."""

import pytest

from bokehnet.errors import ConfigError, LensError
from bokehnet.lenses import PrescriptionLens, catalog_names, load_lens, read_prescription
from bokehnet.lenses.catalog import find_prescription

HEAD = 'name = "x"\nsource = "y"\nfocal_length = 100.0\nf_number = 8.0\nimage_radius = 10.0\n'
STOP = "[[surfaces]]\nstop = true\nthickness = 1.0\nsemi_diameter = 5.0\n"
FRONT = '[[surfaces]]\nradius = 100.0\nthickness = 3.0\nglass = "N-BK7"\nsemi_diameter = 9.0\n'
BACK = "[[surfaces]]\nradius = -100.0\nthickness = 90.0\nsemi_diameter = 9.0\n"


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return path

    return write


def test_a_file_becomes_a_lens_with_the_focal_length_of_the_lens_makers_formula(file):
    lens = load_lens(file(HEAD + STOP + FRONT + BACK))
    n, radius, thickness = 1.5168, 100.0, 3.0
    power = (n - 1) * (2 / radius - (n - 1) * thickness / (n * radius**2))
    assert lens.focal_length == pytest.approx(1 / power, rel=1e-5)


@pytest.mark.parametrize(
    "glass",
    [
        "abbe = [1.5168, 64.17]",
        "sellmeier = [1.03961212, 0.231792344, 1.01046945, 0.00600069867, 0.0200179144, 103.560653]",
        "schott = [2.2718929, -1.0108077e-2, 1.0592509e-2, 2.0816965e-4, -7.6472538e-6, 4.9240991e-7]",
    ],
)
def test_a_glass_has_several_notations(file, glass):
    """The same glass, BK7, by name and by numbers."""
    lens = load_lens(file(HEAD + STOP + FRONT.replace('glass = "N-BK7"', glass) + BACK)).focal_length
    assert lens == pytest.approx(load_lens(file(HEAD + STOP + FRONT + BACK)).focal_length, rel=1e-5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD + STOP + FRONT + BACK.replace("radius", "raduis"), "unknown key 'surfaces[2].raduis'"),
        (HEAD + STOP + FRONT + "[[surfaces]]\nthickness = 1.0\n", "missing key 'surfaces[2].semi_diameter'"),
        (HEAD + FRONT + BACK + BACK, "surfaces: expected two or more, and one with stop"),
        (HEAD + STOP + FRONT + BACK.replace("-100.0", "0.0"), "surfaces[2].radius: expected a radius"),
        (HEAD + STOP + FRONT.replace("BK7", "BK8") + BACK, "surfaces[1].glass: unknown glass 'N-BK8'"),
        (HEAD + STOP + FRONT + "abbe = [1.5, 60.0]\n" + BACK, "surfaces[1].glass: expected one way"),
        (HEAD + STOP + FRONT.replace("9.0", "100.0") + BACK, "surfaces[1].semi_diameter: 100 reaches beyond"),
        (HEAD + FRONT + STOP + BACK, "surfaces[1].stop: expected a plane in air"),
        (HEAD + STOP + BACK + FRONT, "expected air behind the last one"),
        (HEAD.replace("100.0", "-1.0") + STOP + FRONT + BACK, "focal_length: expected 1e-06 to 1e+09"),
        (HEAD + STOP + FRONT.replace('glass = "N-BK7"', "abbe = [1.5, 0.0]") + BACK, "surfaces[1].abbe"),
        (HEAD + STOP + FRONT.replace("3.0", "-3.0") + BACK, "surfaces[1].thickness"),
    ],
)
def test_mistakes_are_reported_with_file_and_key(file, text, words):
    path = file(text)
    with pytest.raises(ConfigError) as caught:
        read_prescription(path)
    assert str(path) in str(caught.value)
    assert words in str(caught.value)


def test_a_lens_that_does_not_focus_is_refused(file):
    text = HEAD + STOP + FRONT.replace("100.0", "-100.0") + BACK.replace("-100.0", "100.0")
    with pytest.raises(LensError, match="focal length above 0"):
        load_lens(file(text))


def test_an_unknown_name_is_an_error_that_lists_the_catalog():
    with pytest.raises(LensError, match=r"'duoble_gauss'.*double_gauss"):
        load_lens("duoble_gauss")


def test_every_catalog_lens_has_a_source():
    expected = {"biconvex", "cooke_triplet", "double_gauss", "petzval", "retrofocus", "telephoto"}
    assert expected <= set(catalog_names())
    for name in catalog_names():
        assert len(find_prescription(name).source) > 20


def test_scaling_keeps_the_shape():
    lens = load_lens("double_gauss", focal_length=50.0)
    full = PrescriptionLens(prescription=find_prescription("double_gauss"))
    assert lens.focal_length == pytest.approx(50)
    assert lens.min_f_number == pytest.approx(full.min_f_number)
    picture = full.prescription.image_radius / full.focal_length
    assert lens.prescription.image_radius / 50 == pytest.approx(picture)
    with pytest.raises(LensError, match="focal length above 0"):
        load_lens("double_gauss", focal_length=0.0)

"""One lens in the formats of six programs: the same prescription, and what is said of what is wrong."""

import json
from dataclasses import replace

import numpy as np
import pytest

from bokehnet.errors import LensError
from bokehnet.lenses import PrescriptionLens, load_lens, read_prescription
from bokehnet.lenses.catalog import find_prescription
from bokehnet.lenses.files.codev import _split
from bokehnet.lenses.files.reading import import_lens
from bokehnet.lenses.prescription_toml import prescription_toml
from bokehnet.lenses.surface_trace import beam_between, trace
from tests.unit.lenses.files.lens_texts import CSV, LEN, OPTILAND, RAYOPTICS, SEQ, ZMX

FORMATS = {
    "a.zmx": ZMX,
    "a.seq": SEQ,
    "a.len": LEN,
    "a.csv": CSV,
    "a.json": json.dumps(OPTILAND),
    "a.roa": json.dumps(RAYOPTICS),
}
INCH = 25.4


@pytest.fixture
def put(tmp_path):
    def write(name, text, encoding="utf-8"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
        return path

    return write


def focal_length() -> float:
    """Of the doublet, mm, by ray matrices written out: three surfaces, two thicknesses."""
    bk7 = 1.5168000345005885  # Schott's Sellmeier formula at 587.5618 nm
    system = np.eye(2)
    for power, gap in (
        ((bk7 - 1) * 0.4, 0.25 / bk7),
        ((1.62 - bk7) * -0.35, 0.1 / 1.62),
        ((1 - 1.62) * -0.1, 0),
    ):
        system = np.array([[1, gap], [0, 1]]) @ np.array([[1, 0], [-power, 1]]) @ system
    return -INCH / system[1, 0]


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_the_same_lens(put, name):
    """Authority: matrices by hand for the focal length, the f-number, rays of the lens of another format."""
    result = import_lens(put(name, FORMATS[name])).prescription
    lens = PrescriptionLens(prescription=result)
    assert result.name == "Doublet"
    assert lens.focal_length == pytest.approx(focal_length(), rel=1e-9)
    assert lens.min_f_number == pytest.approx(focal_length() / (0.8 * INCH), rel=1e-9)
    assert result.image_radius == pytest.approx(focal_length() * np.tan(np.radians(5)), rel=1e-9)
    assert [row.stop for row in result.surfaces] == [True, False, False, False]
    other = PrescriptionLens(prescription=import_lens(put("b.zmx", ZMX)).prescription)
    height = np.linspace(1, 9, 5)
    start = beam_between((height, 0 * height, -1.0), (height, 0.1 + 0 * height, 0.0))
    one, two = (trace(each.surfaces, start) for each in (lens, other))
    np.testing.assert_allclose(one.position, two.position, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(one.direction, two.direction, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig", "latin-1"])
def test_zemax_writes_in_many_encodings(put, encoding):
    text = ZMX.replace("NAME Doublet", "NAME Doppellinse Größe 5")
    result = import_lens(put("a.zmx", text, encoding)).prescription
    assert result.name == "Doppellinse Größe 5"
    assert PrescriptionLens(prescription=result).focal_length == pytest.approx(focal_length(), rel=1e-9)


def test_a_written_lens_is_the_one_that_was_read(put, tmp_path):
    result = import_lens(put("a.seq", SEQ)).prescription
    (tmp_path / "b.toml").write_text(prescription_toml(result))
    assert read_prescription(tmp_path / "b.toml") == result


def test_commands_take_such_a_file_directly(put, cli):
    path = put("a.seq", SEQ)
    assert load_lens(path, focal_length=50.0).focal_length == pytest.approx(50)
    outcome = cli("lens", path)
    assert outcome.code == 0
    assert outcome.out.startswith("Doublet")


def test_assumptions_and_ignored_values_are_reported(put):
    result = import_lens(put("a.zmx", ZMX))
    assert "___BLANK approximated by nd 1.62, Vd 36.3" in result.notes
    assert result.skipped["VERS"] == 1
    assert result.skipped["GCAT"] == 1
    assert "DIAM" not in result.skipped


def test_a_stop_on_a_surface_is_a_plane_at_its_vertex(put):
    """In air in front of glass, inside it where glass is on both sides, in air behind the last surface."""
    base = ZMX.replace("  STOP\n", "")
    for surface, expected in (("SURF 2\n", 0), ("SURF 3\n", 2), ("SURF 4\n", 3)):
        result = import_lens(put("a.zmx", base.replace(surface, surface + "  STOP\n"))).prescription
        lens = PrescriptionLens(prescription=result)
        assert [row.stop for row in result.surfaces].index(True) == expected
        assert lens.min_f_number == pytest.approx(focal_length() / (0.8 * INCH), rel=1e-9)
        assert lens.focal_length == pytest.approx(focal_length(), rel=1e-9)


def test_glass_comes_from_a_catalogue_in_the_same_folder(put):
    """AGF formula 2 is Sellmeier's, so that this is N-BK7 by another name."""
    put(
        "mine.AGF",
        "CC ours\nNM MYCROWN 2 517642 1.5168 64.17 0 0\nCD 1.03961212 0.00600069867 0.231792344 "
        "0.0200179144 1.01046945 103.560653\n",
    )
    result = import_lens(put("a.zmx", ZMX.replace("N-BK7", "MYCROWN"))).prescription
    assert PrescriptionLens(prescription=result).focal_length == pytest.approx(focal_length(), rel=1e-9)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.zmx", ZMX.replace("TYPE EVENASPH", "TYPE TOROIDAL"), ["line 24", "TYPE", "TOROIDAL"]),
        (
            "a.zmx",
            ZMX.replace("N-BK7 0 0 1.5 40", "UNOBTAINIUM 0 0 1.5 40"),
            ["line 29", "GLAS", "UNOBTAINIUM"],
        ),
        ("a.zmx", ZMX.replace("N-BK7", "MIRROR"), ["thickness", "along the light"]),
        ("a.zmx", ZMX.replace("DISZ 0.25", "DISZ -0.25"), ["thickness", "-0.25"]),
        ("a.zmx", ZMX.replace("CURV 0.4", "CURV abc"), ["line 25", "CURV", "abc"]),
        ("a.zmx", ZMX.replace("CURV 0.4", "CURV nan"), ["radius", "nan"]),
        ("a.zmx", ZMX.replace("MODE SEQ", "MODE NSC"), ["line 2", "MODE", "NSC"]),
        ("a.zmx", ZMX.replace("ENPD 0.8", "ENPD 0"), ["aperture", "above 0"]),
        ("a.zmx", "junk\n" * 2000, ["SURF", "expected surfaces"]),
        ("a.zmx", b"\x89\x01\x02\x00\x03" * 4000, ["expected text"]),
        ("a.seq", SEQ.replace("  STO\n", "  STO\n  ADE 5.0\n"), ["line 12", "ADE"]),
        ("a.seq", SEQ.replace("NBK7_SCHOTT", "REFL"), ["thickness", "along the light"]),
        ("a.seq", "", ["expected surfaces"]),
        ("a.len", LEN.replace("CC -0.5", "RFL"), ["thickness", "along the light"]),
        ("a.len", "nothing\n", ["LEN"]),
        ("a.csv", "a, b\n1, 2\n", ["line 1", "R"]),
        ("a.csv", CSV.replace("1.62, 36.3", "glass, 36.3"), ["line 7", "N", "glass"]),
        ("a.json", "{", ["JSON"]),
        ("a.json", "[]", ["surface_group"]),
        ("a.roa", "{}", ["optical_model"]),
    ],
)
def test_mistakes_are_one_line_with_file_line_and_key(put, name, text, words):
    path = put(name, text)
    with pytest.raises(LensError) as caught:
        import_lens(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    for word in words:
        assert word in message


def test_a_file_whose_glass_no_ray_passes_is_named(put):
    """No ray of a pupil of 10 mm meets a ball of 0.125 mm; the file alone says nothing wrong."""
    surfaces = (
        "SURF 0\n  CURV 0\n  DISZ INFINITY\n"
        "SURF 1\n  CURV 0.02\n  DISZ 4\n  GLAS N-BK7 0 0 1.5168 64.17\n  DIAM 8\n"
        "SURF 2\n  CURV -8\n  DISZ 60\n  DIAM 8\nSURF 3\n  CURV 0\n  DISZ 0\n"
    )
    header = "MODE SEQ\nUNIT MM\nENPD 10\nFTYP 0 0 1 1 0 0 0\nYFLN 5\nWAVM 1 0.5875618 1\n"
    path = put("a.zmx", header + surfaces)
    with pytest.raises(LensError, match=r"a\.zmx: no ray passes"):
        load_lens(path)


@pytest.mark.parametrize(
    ("line", "parts"),
    [
        ('THI S1 4; GL "a;b"', ["THI S1 4", ' GL "a;b"']),
        ("TITLE 'x;y';STO", ["TITLE 'x;y'", "STO"]),
        ("a;;b", ["a", "b"]),
        ('5" lens;STO', ['5" lens', "STO"]),
    ],
)
def test_commands_of_codev_end_outside_quotation_marks(line, parts):
    assert _split(line, ";") == parts


@pytest.mark.parametrize("value", [1e-308, 1e-7, 1e10, float("inf"), float("nan")])
@pytest.mark.parametrize("key", ["focal_length", "image_radius", "f_number"])
def test_lengths_that_rays_cannot_resolve_are_refused(key, value):
    """An image circle of 1e-308 mm ended in an index error in the effective pupil."""
    problem = replace(find_prescription("biconvex"), **{key: value}).problem()
    assert problem is not None
    assert problem.startswith(f"{key}: expected 1e-06 to 1e+09")


@pytest.mark.parametrize("value", [1e-308, 1e10])
def test_apertures_that_rays_cannot_resolve_are_refused(value):
    lens = find_prescription("biconvex")
    rows = (replace(lens.surfaces[0], semi_diameter=value), *lens.surfaces[1:])
    assert "semi_diameter" in (replace(lens, surfaces=rows).problem() or "")

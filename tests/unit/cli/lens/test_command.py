"""``bokehnet lens``."""

import json
import re

import pytest

from bokehnet.lenses import catalog_names
from bokehnet.lenses.reports import report_sheet


@pytest.fixture
def few_rays(monkeypatch):
    """Discs of lamps from few rays: what they show is tested with the tracer."""
    monkeypatch.setattr(report_sheet, "_RAYS", 500)


def test_without_a_name_the_catalog_is_listed(cli):
    outcome = cli("lens")
    assert (outcome.code, outcome.err) == (0, "")
    for name in catalog_names():
        assert name in outcome.out
    assert "100 mm f/2, Double Gauss" in outcome.out


def test_a_lens_is_described(cli):
    outcome = cli("lens", "double_gauss", "--focal", 50, "--f-number", 2.8, "--focus", 2)
    assert (outcome.code, outcome.err) == (0, "")
    assert re.search(r"focal length +50\.000 mm by matrix, 49\.99\d mm traced", outcome.out)
    assert re.search(
        r"f-number +2\.800 paraxial, 2\.8\d\d working; fully open 2\.01\d paraxial, published 2", outcome.out
    )
    for label in ("source", "principal planes", "exit pupil", "depth of field", "rays that pass"):
        assert label in outcome.out
    assert "focus                2 m from the entrance pupil" in outcome.out


def test_a_file_is_described_and_drawn(cli, tmp_path, no_bar):
    pytest.importorskip("matplotlib")
    text = 'name = "Mine"\nsource = "me"\nfocal_length = 100.0\nf_number = 10.0\nimage_radius = 10.0\n'
    text += "[[surfaces]]\nstop = true\nthickness = 1.0\nsemi_diameter = 5.0\n"
    text += "[[surfaces]]\nradius = 100.0\nthickness = 3.0\nabbe = [1.5, 60.0]\nsemi_diameter = 9.0\n"
    text += "[[surfaces]]\nradius = -100.0\nthickness = 90.0\nsemi_diameter = 9.0\n"
    (tmp_path / "mine.toml").write_text(text)
    outcome = cli("lens", tmp_path / "mine.toml", "--plot", tmp_path / "out.png")
    assert (outcome.code, outcome.err) == (0, "")
    assert "Mine" in outcome.out
    assert (tmp_path / "out.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nolens"], ["'nolens'", "double_gauss"]),
        (["no.toml"], ["no.toml"]),
        (["retrofocus", "--focus", "0.05"], ["Retrofocus", "cannot focus at 50 mm"]),
        (["double_gauss", "--f-number", "1"], ["f-number", "2.01"]),
        (["double_gauss", "--focal", "-5"], ["focal length above 0"]),
        (["--focal", "50"], ["NAME: expected a lens or a TOML file", "got none"]),
        (["biconvex", "--plot", "nowhere/out.png"], ["nowhere/out.png"]),
        (["biconvex", "--plot", "out.gif"], ["out.gif: unknown extension '.gif', expected one of .png"]),
        (["report", "biconvex", "-o", "out.gif"], ["out.gif: unknown extension", "expected one of .html"]),
        (["compare", "biconvex", "petzval", "-o", "out"], ["out: unknown extension", ".pdf"]),
    ],
)
def test_mistakes_are_one_line(cli, no_bar, arguments, words):
    outcome = cli("lens", *arguments)
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err.startswith("bokehnet: error: ")
    assert outcome.err.count("\n") == 1
    for word in words:
        assert word in outcome.err


ZMX = """MODE SEQ
NAME Singlet
UNIT MM X W
ENPD 10
YFLN 0 8
SURF 0
DISZ INFINITY
SURF 1
STOP
CURV 0.02
DISZ 4
GLAS N-BK7 0 0 1.5168 64.17
SURF 2
CURV -0.01
DISZ 60
SURF 3
"""


def test_a_file_of_another_program_is_imported_and_used(cli, tmp_path):
    """Authority: the lens maker's formula."""
    (tmp_path / "a.zmx").write_text(ZMX)
    power = 0.5168 * (0.03 - 0.5168 * 4 * 0.0002 / 1.5168)
    outcome = cli("lens", "import", tmp_path / "a.zmx", "-o", tmp_path / "a.toml")
    assert (outcome.code, outcome.err) == (0, "")
    assert "clear apertures of 2 surfaces computed" in outcome.out
    assert f"{1 / power:.4g}" in outcome.out
    for file in ("a.zmx", "a.toml"):
        shown = cli("lens", tmp_path / file)
        assert f"{1 / power:.2f}" in shown.out


def test_an_import_that_fails_writes_nothing(cli, tmp_path):
    (tmp_path / "a.zmx").write_text(ZMX.replace("N-BK7 0 0 1.5168 64.17", "UNOBTAINIUM 0 0 1.5 40"))
    outcome = cli("lens", "import", tmp_path / "a.zmx", "-o", tmp_path / "a.toml")
    assert (outcome.code, outcome.out) == (1, "")
    assert "line 12: GLAS" in outcome.err
    assert not (tmp_path / "a.toml").exists()


@pytest.mark.slow
def test_two_lenses_stand_side_by_side(cli):
    numbers = json.loads(cli("lens", "compare", "double_gauss", "petzval", "--json").out)
    assert [round(facts["back_focus"], 2) for facts in numbers] == [71.44, 56.45]


@pytest.mark.slow
def test_a_report_as_json_holds_the_curves(cli):
    outcome = cli("lens", "report", "petzval", "--f-number", 4, "--json")
    assert (outcome.code, outcome.err) == (0, "")
    summary = json.loads(outcome.out)
    assert summary["f_number"] == pytest.approx(4)
    assert summary["curves"]["relative_illumination"][0] == 1
    curves = summary["curves"]
    assert len(curves["mtf"]) == len(curves["ray_fans"]) == len(curves["wave_mtf"]) == 3
    assert [len(front["zernike"]) for front in curves["wavefronts"]] == [22] * 3
    near, far = curves["depth_of_field"]["range"]
    assert near > 0
    assert far is None  # up to infinity
    spots = curves["spots"][0]
    assert min(spots["rms_radius"]) == min(spots["rms_radius"][3:6])  # in focus, not beside it


def test_a_report_wants_a_place_to_be_written(cli, tmp_path):
    outcome = cli("lens", "report", "petzval")
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err == "bokehnet: error: --output: expected a file for the sheet, or --json, got neither\n"
    outcome = cli("lens", "report", "petzval", "-o", tmp_path / "nowhere" / "a.html")
    assert outcome.code == 1
    assert "nowhere" in outcome.err


@pytest.mark.slow
def test_a_report_is_one_page_with_its_picture(cli, tmp_path, no_bar, few_rays):
    pytest.importorskip("matplotlib")
    outcome = cli("lens", "report", "biconvex", "-o", tmp_path / "a.html")
    assert (outcome.code, outcome.err) == (0, "")
    text = (tmp_path / "a.html").read_text()
    assert "data:image/png;base64," in text
    assert "<td>Z11, spherical</td>" in text
    assert "<th>focal length</th><td>99.996</td>" in text
    assert text.count("<tr>") > 20


@pytest.mark.slow
def test_two_sheets_are_one_pdf(cli, tmp_path, no_bar, monkeypatch):
    """A PDF begins with its version and ends with its mark, ISO 32000-1, 7.5; the sheets are empty here."""
    figure = pytest.importorskip("matplotlib.figure", reason="needs the extra plots")
    monkeypatch.setattr(report_sheet, "report_figure", lambda lenses: figure.Figure())
    outcome = cli("lens", "compare", "biconvex", "petzval", "--f-number", 8, "-o", tmp_path / "a.pdf")
    assert (outcome.code, outcome.err) == (0, "")
    result = (tmp_path / "a.pdf").read_bytes()
    assert result.startswith(b"%PDF-1.")
    assert result.rstrip().endswith(b"%%EOF")
    assert re.search(r"Biconvex.* +Petzval", outcome.out)
    assert re.search(r"f number +8 +8", outcome.out)

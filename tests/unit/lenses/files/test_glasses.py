"""Glass catalogues: formulas against printed indices."""

import pytest

from bokehnet.errors import LensError
from bokehnet.lenses.files.glass.glasses import GlassCatalogues, read_agf, read_yaml_glass
from bokehnet.optics.spectral.glass import C_LINE, D_LINE, F_LINE, FormulaGlass, make_glass

BK7 = (1.03961212, 0.00600069867, 0.231792344, 0.0200179144, 1.01046945, 103.560653)


def agf(kind, numbers):
    return (
        f"! remark\nCC test\nNM GLASS-1 {kind} 517642 1.5 60 0 1\nED 1 2\nCD {' '.join(map(repr, numbers))}\n"
    )


@pytest.mark.parametrize(
    ("kind", "numbers", "nd"),
    [
        # Schott 1966: BK7 by the power series.
        (1, (2.2718929, -1.0108077e-2, 1.0592509e-2, 2.0816965e-4, -7.6472538e-6, 4.9240991e-7), 1.51680),
        (2, BK7, 1.51680),
        # Malitson 1965, fused silica, three of six Sellmeier terms: 1.45846.
        (2, (0.6961663, 0.0684043**2, 0.4079426, 0.1162414**2, 0.8974794, 9.896161**2), 1.45846),
        # Cauchy's n = A + B / w with Conrady's term 0; n = 1.5 + 0.01 / 0.5875618.
        (5, (1.5, 0.01, 0.0), 1.5 + 0.01 / 0.5875618),
        # Handbook 2 with D = 0 is one term of Sellmeier's: n^2 = 1 + w^2 / (w^2 - 0.01).
        (8, (1.0, 1.0, 0.01, 0.0), (1 + 0.5875618**2 / (0.5875618**2 - 0.01)) ** 0.5),
        # Extended 2 begins as Schott's formula and ends with w^4 and w^6.
        (12, (2.25, 0, 0, 0, 0, 0, 0.01, 0.02), (2.25 + 0.01 * 0.5875618**4 + 0.02 * 0.5875618**6) ** 0.5),
    ],
)
def test_formulas_of_agf_give_printed_indices(tmp_path, kind, numbers, nd):
    path = tmp_path / "c.agf"
    path.write_bytes(agf(kind, numbers).encode("utf-16"))
    assert float(read_agf(path)["GLASS1"].index(D_LINE)) == pytest.approx(nd, abs=2e-5)


@pytest.mark.parametrize(
    ("text", "nd"),
    [
        ("  - type: formula 2\n    coefficients: 0 " + " ".join(map(repr, BK7)), 1.51680),
        (
            "  - type: formula 1\n"
            "    coefficients: 0 0.6961663 0.0684043 0.4079426 0.1162414 0.8974794 9.896161",
            1.45846,
        ),
        ("  - type: formula 5\n    coefficients: 1.4 0.005 -2", 1.4 + 0.005 / 0.5875618**2),
        ("  - type: tabulated nk\n    data: |\n        0.5 1.6 0\n        0.6 1.5 0\n", 1.6 - 0.875618 * 0.1),
    ],
)
def test_materials_of_refractiveindex_info(tmp_path, text, nd):
    path = tmp_path / "x.yml"
    path.write_text(f"REFERENCES: ours\nDATA:\n{text}\n")
    assert float(read_yaml_glass(path).index(D_LINE)) == pytest.approx(nd, abs=1e-5)


def test_names_are_compared_without_dashes_and_the_maker_decides(tmp_path):
    for maker, index in (("schott", 1.5), ("ohara", 1.6)):
        (tmp_path / maker).mkdir()
        text = f"DATA:\n  - type: formula 5\n    coefficients: {index} 0 -2\n"
        (tmp_path / maker / "N-XX7.yml").write_text(text)
    known = GlassCatalogues((tmp_path,))
    assert float(known.find("nxx7", "OHARA").index(D_LINE)) == pytest.approx(1.6)
    assert float(known.find("N-XX7", "SCHOTT").index(D_LINE)) == pytest.approx(1.5)
    assert known.find("N-SK16") == make_glass("N-SK16")
    assert known.find("nobody") is None


def test_a_catalogue_that_is_wrong_is_reported(tmp_path):
    (tmp_path / "c.agf").write_text("NM A two\n")
    with pytest.raises(LensError, match=r"c.agf, line 1: NM: expected numbers"):
        read_agf(tmp_path / "c.agf")
    (tmp_path / "x.yml").write_text("DATA:\n  - type: formula 9\n    coefficients: 1 2 3\n")
    with pytest.raises(LensError, match=r"x.yml, line 3: coefficients: formula 9 is not known"):
        read_yaml_glass(tmp_path / "x.yml")


def test_abbe_number_of_a_formula():
    """Schott's data sheet: N-BK7 has Vd 64.17."""
    glass = FormulaGlass(powers=((1.0, 0.0),), poles=tuple((BK7[i], 2.0, BK7[i + 1], 1.0) for i in (0, 2, 4)))
    d, f, c = (float(glass.index(line)) for line in (D_LINE, F_LINE, C_LINE))
    assert (d - 1) / (f - c) == pytest.approx(64.17, abs=0.005)

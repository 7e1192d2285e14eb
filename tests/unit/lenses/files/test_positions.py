"""Zooms and floating groups: focal lengths as the patent prints them, gaps of the file."""

import math
from pathlib import Path

import pytest

from bokehnet.errors import ConfigError, LensError
from bokehnet.lenses.catalog import find_prescription, load_lens
from bokehnet.lenses.files.reading import import_lens
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.prescription_file import read_prescription
from bokehnet.lenses.prescription_toml import prescription_toml

# US 5,537,259, 72 to 194 mm, f/2.9: radius, thickness in three positions, index, Abbe number, half aperture.
_ZOOM = """\
#FOV 34 18.3 12 // diagonal
311.919 2.80 LAFN7 1.7495 35 38
118.63 0.42 air 38
128.135 8.68 NPK52A 1.497 81.6 38
-263.46 0.1 air 38
79.501 5.72 NPK52A 1.497 81.6 35
203.191 8.78/26.15/32.85 air 35
54.391 2.2 NSF57 1.847 23.8 28
45.859 1.13 air 28
51.927 8.55 NFK5 1.487 70.2 28
5099.30 1.64/12.89/17.23 air 28
-488.6 1.4 NLASF44 1.804 46.6 18
35.390 5.88 air 18
-78.125 1.4 NFK5 1.487 70.2 18
38.137 4.97 NSF57 1.847 23.9 18
417.478 2.65 air 18
-66.802 1.4 NLAK34 1.729 54.7 18
-3363.0 30.32/15.72/1.32 air 18
247.12 3.49 NLAK14 1.697 55.5 19
-99.902 0.15 air 19
-189.99 4.77 NPK52A 1.497 81.6 19
-40.553 1.45 NLASF40 1.834 37.2 19
-76.277 14.7/0.69/4.05 air 19 // moves
58.421 3.53 NLASF44 1.804 46.6 21
133.262 3 air 21
10000 0.24 IRIS 21
34.132 6.35 NPK52A 1.497 81.6 21
2256.763 3.72 F2 1.620 36.3 21
31.519 28.17 air 21
132.947 5.9 NKF9 1.517 52.4 21
-77.546 13.94 air 21
-39.485 1.8 NLASF40 1.834 37.2 21
-95.683 0.15 air 21
147.644 3.62 NLAF35 1.743 49.3 21
-205.76 54.5 air 21
"""
_MOVING = """\
RDM; LEN
DIM M
EPD 10
YAN 0 5
ZOO 2
ZOO EPD 10 12
SO 0 1e20
S 50 4 517642
S -60 5 AIR
STO
S -90 2 620364
S 300 70 AIR
SI 0 0
ZOO THI S0 1e20 500
ZOO THI S2 5 7.5
"""


def _focal_length(path: str) -> float:
    return PrescriptionLens(prescription=find_prescription(path)).focal_length


def test_each_position_of_a_zoom_has_the_focal_length_that_is_printed(tmp_path: Path) -> None:
    path = tmp_path / "zoom.fx"
    path.write_text(_ZOOM)
    # Indices have three decimal places.
    for position, printed in ((1, 72.10), (2, 135.0), (3, 194.01)):
        assert _focal_length(f"{path}@{position}") == pytest.approx(printed, rel=0.01)
    first = import_lens(path)
    assert any("first of 3 positions" in sentence for sentence in first.notes)
    assert not first.prescription.floating


def test_a_position_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "zoom.fx"
    path.write_text(_ZOOM)
    with pytest.raises(LensError, match=r"zoom\.fx: position: expected 1 to 3, got 4$"):
        import_lens(f"{path}@4")
    with pytest.raises(LensError, match=r"expected 1 to 3, got 0$"):
        import_lens(f"{path}@0")
    path.write_text(_ZOOM.replace("14.7/0.69/4.05", "14.7/0.69"))
    with pytest.raises(LensError, match="as many positions"):
        import_lens(path)


def test_groups_float_between_the_listed_distances(tmp_path: Path) -> None:
    path = tmp_path / "floats.seq"
    path.write_text(_MOVING)
    result = import_lens(path).prescription
    assert [row.distance for row in result.floating] == [500.0, math.inf]
    gap = next(i for i, row in enumerate(result.surfaces) if row.thickness == 5.0)
    assert result.focused(math.inf).surfaces[gap].thickness == 5.0
    assert result.focused(1000.0).surfaces[gap].thickness == pytest.approx(6.25)
    assert result.focused(100.0).surfaces[gap].thickness == 7.5
    assert result.scaled(2.0).focused(2000.0).surfaces[gap].thickness == pytest.approx(12.5)
    lens = load_lens(path, focus_distance=1000.0)
    assert lens.prescription.surfaces[gap].thickness == pytest.approx(6.25, rel=0.02)
    assert lens.focal_length != pytest.approx(load_lens(path).focal_length, rel=1e-3)
    copy = tmp_path / "copy.toml"
    copy.write_text(prescription_toml(result))
    assert read_prescription(copy) == result
    copy.write_text(prescription_toml(result).replace("distance = 500.0", "distance = -1.0"))
    with pytest.raises(ConfigError, match="floating"):
        read_prescription(copy)


def test_configurations_of_zemax(tmp_path: Path) -> None:
    rows = ["MODE SEQ", "UNIT MM", "ENPD 8", "FTYP 0", "YFLN 3", "MNUM 2 1"]
    rows += ["THIC 2 1 5.0 0 0 0", "THIC 2 2 9.0 0 0 0"]
    for curvature, gap, glass in ((0, "INFINITY", ""), (0.02, 4, "517642"), (-0.015, 5, ""), (0, 60, "")):
        rows += ["SURF 0", f"CURV {curvature}", f"DISZ {gap}"] + ([f"GLAS {glass}"] if glass else [])
    path = tmp_path / "two.zmx"
    path.write_text("\n".join([*rows, "SURF 4", "DISZ 0"]))
    first, second = (import_lens(f"{path}@{i}").prescription for i in (1, 2))
    assert sum(row.thickness for row in second.surfaces) == pytest.approx(
        sum(row.thickness for row in first.surfaces) + 4
    )


def test_q_polynomials_are_even_powers() -> None:
    """Forbes, 2007: the first strong terms are 1, 6 x - 5 and 28 x^2 - 42 x + 15."""
    from bokehnet.lenses.files.forbes import mild_powers, strong_powers

    result = strong_powers([0.0, 0.0, 1.0], 2.0)
    assert result == pytest.approx([0.0, 15 / 2**4, -42 / 2**6, 28 / 2**8])
    assert strong_powers([0.0, 1.0], 1.0) == pytest.approx([0.0, -5.0, 6.0])
    # Of a plane the root is 1: u^2 (1 - u^2) (13 - 16 u^2) / sqrt(19).
    flat = mild_powers([0.0, 1.0], 1.0, 0.0)
    assert flat[:3] == pytest.approx([13 / 19**0.5, -29 / 19**0.5, 16 / 19**0.5], abs=1e-9)

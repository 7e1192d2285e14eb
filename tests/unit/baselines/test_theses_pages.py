"""Statements of the pages on the theses: files that exist, and figures that support the text."""

import json
import re
from pathlib import Path

import pytest

from bokehnet.baselines import BASELINES

ROOT = Path(__file__).parents[3]
PAGES = ROOT / "docs/method"


def rows(name):
    return json.loads((ROOT / f"docs/figures/{name}.json").read_text(encoding="utf-8"))["rows"]


def test_every_file_of_the_chapters_exists():
    """A bare file name is in the folder of the file before it, or in another room."""
    text = (PAGES / "theses_chapters.md").read_text(encoding="utf-8")
    names = set(re.findall(r"`([\w/]+\.(?:py|toml))`", text))
    assert len(names) > 60
    files = [path.relative_to(ROOT).as_posix() for path in ROOT.glob("bokehnet/**/*") if path.is_file()]
    missing = [name for name in names if not any(f"/{path}".endswith(f"/{name}") for path in files)]
    assert not missing


def test_every_baseline_is_on_the_page():
    text = (PAGES / "theses.md").read_text(encoding="utf-8")
    assert [name for name in BASELINES if f"| {name} |" not in text] == []
    assert [name for name in BASELINES if f"`{name}`" not in text] == []


def test_rays_do_not_depend_on_the_scene_and_views_do():
    measured = list(rows("bokehlab_triangles").values())
    assert measured[-1]["views"] > 4 * measured[0]["views"]
    assert measured[-1]["rays"] < 1.5 * measured[0]["rays"]


def test_tables_of_32_cells_suffice_and_poles_are_worse():
    measured = rows("bokehlab_transfer")
    assert measured["32^3"]["spherical"] < 0.05 < 0.3 < measured["8^3"]["spherical"]
    for row in measured.values():
        assert row["spherical"] > 3 * row["square"]


def test_floats_of_32_bits_are_exact_and_others_darken():
    measured = rows("bokehlab_accumulators")
    assert abs(measured["32-bit floats"]["light"]) < 0.001
    assert measured["16-bit floats"]["light"] < -0.1
    assert measured["12-bit integers"]["light"] < -0.1


def test_time_rises_with_surfaces_and_samples():
    lenses = list(rows("bokehlab_surfaces").values())
    assert lenses[-1]["surfaces"] > 3 * lenses[0]["surfaces"]
    assert lenses[-1]["seconds"] > 1.5 * lenses[0]["seconds"]
    views = rows("jeong_samples")
    assert views["64 samples"]["ms"] == pytest.approx(64 / 16 * views["16 samples"]["ms"], rel=0.4)


def test_the_ends_of_the_spectrum_have_little_light():
    assert max(row["percent"] for row in rows("jeong_spectrum").values()) < 0.5


def test_merged_lights_are_faster_and_our_mapping_agrees_better():
    assert all(row["speed"] > 1 for row in rows("jeong_merged").values())
    assert all(row["ours"] > row["printed"] for row in rows("jeong_profiles").values())


def test_levels_lose_textures_and_finer_ones_recover_some():
    measured = rows("jeong_motion")
    coarse, finer, fine = (measured[name] for name in ("levels", "levels, 2 finer", "finest level"))
    assert coarse["psnr"] < finer["psnr"] < fine["psnr"]
    assert coarse["triangles"] < finer["triangles"] < 0.1 * fine["triangles"]


def test_clusters_and_importance_have_less_noise_than_one_wavelength():
    measured = {name: row["rms"] for name, row in rows("marsicano_clusters").items()}
    random = measured["one random wavelength"]
    assert measured["clusters of 8, no dispersion"] < random / 100
    assert measured["one wavelength by importance (ours)"] < random / 30


def test_grooves_draw_rings_until_they_overlap():
    contrast = [row["contrast"] for row in rows("marsicano_polishing").values()]
    assert contrast[0] < 1 < 10 < contrast[1]
    assert contrast[-1] < contrast[-2]


def test_seidel_sums_are_right_for_a_singlet_and_wrong_for_corrected_lenses():
    measured = rows("marsicano_seidel")
    scores = {}
    for lens in ("biconvex", "cooke_triplet", "double_gauss"):
        gaussian, seven = (measured[f"{lens}, {kind}"] for kind in ("Gaussian optics", "seven parameters"))
        three = next(row for name, row in measured.items() if name.startswith(f"{lens}, best three"))
        assert three["rmse"] < gaussian["rmse"]
        scores[lens] = gaussian["rmse"], three["rmse"], seven["rmse"]
    assert scores["biconvex"][2] < scores["biconvex"][1]
    assert scores["cooke_triplet"][1] < scores["cooke_triplet"][2]
    assert scores["double_gauss"][0] < scores["double_gauss"][2]

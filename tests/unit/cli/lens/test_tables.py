"""``bokehnet lens aberrations``, ``copy``, ``preset``, ``profile`` and ``transfer``."""

import json
import re
from functools import partial

import numpy as np
import pytest

from bokehnet.io.image import read_image, write_image
from bokehnet.lenses.aberrations import lens_preset as presets


def test_a_table_is_written_and_rendered_with(cli, tmp_path):
    """Authority: the same lens by --lens, by third-order theory, without its darkening and its rims."""
    table = tmp_path / "a.csv"
    outcome = cli("lens", "aberrations", "petzval", "--theory", "seidel", "-o", table)
    assert (outcome.code, outcome.err) == (0, "")
    assert "64 wavelengths, 0 vignetting apertures" in outcome.out
    assert table.read_text().startswith("# name = Petzval\n# focal_length = 99.98")
    rng = np.random.default_rng(0)
    write_image(tmp_path / "in.exr", rng.uniform(0, 1, (24, 32, 3)).astype(np.float32))
    write_image(tmp_path / "z.exr", np.full((24, 32, 3), 0.2, np.float32))
    common = ["render", tmp_path / "in.exr", "--disparity", tmp_path / "z.exr", "--blur", 10, "--focus", 0.5]
    pictures = []
    for number, how in enumerate(
        (["--aberration-table", table], ["--lens", "petzval", "--aberrations", "seidel"], [])
    ):
        extra = ["--no-lens-vignetting"] if "--lens" in how else []
        outcome = cli(*common, *how, *extra, "-o", tmp_path / f"{number}.exr")
        assert outcome.code == 0, outcome.err
        pictures.append(read_image(tmp_path / f"{number}.exr"))
    np.testing.assert_allclose(pictures[0], pictures[1], atol=1e-5)
    assert np.abs(pictures[0] - pictures[2]).max() > 1e-3


@pytest.mark.slow
def test_a_lens_becomes_a_preset_with_its_table(cli, tmp_path, no_bar, monkeypatch):
    monkeypatch.setattr(presets, "lens_preset", partial(presets.lens_preset, rays=2000))
    outcome = cli("lens", "preset", "biconvex", "-o", tmp_path / "mine.toml")
    assert (outcome.code, outcome.err) == (0, "")
    assert re.search(r"correlation with traced points 0\.9\d+", outcome.out)
    assert 'aberration-table = "mine.csv"' in (tmp_path / "mine.toml").read_text()
    write_image(tmp_path / "in.png", np.full((16, 16, 3), 0.5, np.float32))
    selected = cli(
        "render",
        tmp_path / "in.png",
        "--disparity",
        tmp_path / "in.png",
        "--blur",
        3,
        "--focus",
        0.2,
        "--preset",
        tmp_path / "mine.toml",
        "-o",
        tmp_path / "out.png",
    )
    assert selected.code == 0, selected.err


@pytest.mark.slow
def test_a_transfer_function_is_stored_and_is_a_lens_then(cli, tmp_path):
    outcome = cli("lens", "transfer", "petzval", "--one-colour", "-o", tmp_path / "a.npz")
    assert (outcome.code, outcome.err) == (0, "")
    assert re.search(r"0\.7 to 1\.0 +0\.0\d+ +0\.0\d+", outcome.out)
    shown = cli("lens", tmp_path / "a.npz")
    assert shown.code == 0
    assert "99.98" in shown.out


@pytest.mark.slow
def test_a_copy_is_a_lens_file_and_one_side_of_its_picture_is_softer(cli, tmp_path):
    outcome = cli(
        "lens", "copy", "petzval", "--copy-to-copy", 10, "--seed", 3, "-o", tmp_path / "c.toml", "--json"
    )
    assert (outcome.code, outcome.err) == (0, "")
    design, copy = json.loads(outcome.out)
    assert design["image_lean"] == [0, 0]
    assert np.hypot(*copy["image_lean"]) > 0.05  # degrees
    assert "shift = [" in (tmp_path / "c.toml").read_text()
    result = cli("lens", "copy", "petzval", "--copies", 3, "--tilt", 0)
    assert [line.split("  ")[0] for line in result.out.splitlines()[2:]] == [
        "design",
        "copy 0",
        "copy 1",
        "copy 2",
    ]
    # A wall in focus: the design leaves it sharp as far as its field is flat, and even; the copy leans.
    rng = np.random.default_rng(0)
    write_image(tmp_path / "in.exr", np.repeat(rng.uniform(0, 1, (32, 48, 1)), 3, -1).astype(np.float32))
    write_image(tmp_path / "z.exr", np.full((32, 48, 3), 0.5, np.float32))
    common = ["render", tmp_path / "in.exr", "--disparity", tmp_path / "z.exr", "--blur", 10, "--focus", 0.5]
    seen = {}
    for number, lens in enumerate(
        (["petzval"], [tmp_path / "c.toml"], ["petzval", "--copy-to-copy", 10, "--copy-seed", 3])
    ):
        maps = tmp_path / f"maps{number}"
        outcome = cli(*common, "--lens", *lens, "--save-maps", maps, "-o", tmp_path / f"{number}.exr")
        assert outcome.code == 0, outcome.err
        seen[number] = read_image(maps / "defocus.exr")[..., 0]
    assert np.abs(seen[0]).max() == 0
    np.testing.assert_allclose(seen[1], seen[2], atol=1e-6)
    assert seen[1].max() > 0 > seen[1].min()
    assert abs(float(seen[1].mean())) < 1e-6


@pytest.mark.slow
def test_a_profile_texture_is_compared_and_stored(cli, tmp_path, no_bar, monkeypatch):
    from bokehnet.lenses.lookup import profile_comparison
    from bokehnet.lenses.lookup.profile_file import read_profile

    whole = profile_comparison.compare_profiles
    monkeypatch.setattr(
        profile_comparison, "compare_profiles", lambda lens, **message: whole(lens, **message, rays=300)
    )
    path = tmp_path / "p.npz"
    outcome = cli("lens", "profile", "petzval", "--focus", 3, "--rows", 9, "--columns", 16, "-o", path)
    assert outcome.code == 0, outcome.err
    assert re.search(r"aberration map +\d+ +\d", outcome.out)
    assert re.search(r"profile texture +\d+ +\d", outcome.out)
    texture, lens = read_profile(path)
    assert texture.light.shape == (9, 16)
    assert lens.focus_distance == 3000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["copy", "petzval", "-o", "a.csv"], "--output: expected a file that ends in .toml"),
        (["copy", "petzval", "--copies", "2", "-o", "a.toml"], "--output: expected one copy"),
        (["copy", "petzval", "--copies", "0"], "--copies: expected 1 to 1000, got 0"),
        (["copy", "petzval", "--copy-to-copy", "-1"], "--copy-to-copy: expected 0 or more, got -1"),
        (["copy", "petzval", "--tilt", "nan"], "tilt: expected"),
        (["profile", "petzval", "--rows", "1"], "--rows: expected 2 to 4096, got 1"),
        (["profile", "petzval", "-o", "a.png"], "--output: expected a file that ends in .npz"),
        (["preset", "petzval", "-o", "a.txt"], "--output: expected a file that ends in .toml, got 'a.txt'"),
        (["transfer", "petzval", "-o", "a.csv"], "--output: expected a file that ends in .npz"),
        (["transfer", "petzval", "--degree", "20"], "--degree: expected 1 to 8, got 20"),
        (["aberrations", "none", "-o", "a.csv"], "unknown lens 'none'"),
        (["aberrations", "petzval", "-o", "nowhere/a.csv"], "nowhere"),
    ],
)
def test_mistakes_are_one_line(cli, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    outcome = cli("lens", *arguments)
    assert (outcome.code, outcome.out) == (1, "")
    assert words in outcome.err
    assert outcome.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []

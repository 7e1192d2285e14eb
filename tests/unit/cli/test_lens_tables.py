"""``bokehnet lens aberrations``, ``preset`` and ``transfer``."""

import re

import numpy as np
import pytest

from bokehnet.io.image import read_image, write_image


def test_a_table_is_written_and_rendered_with(cli, tmp_path):
    """Authority: the same lens by --lens, by third-order theory, without its darkening and its rims."""
    table = tmp_path / "a.csv"
    outcome = cli("lens", "aberrations", "petzval", "--theory", "seidel", "-o", table)
    assert (outcome.code, outcome.err) == (0, "")
    assert "64 wavelengths, 0 rims" in outcome.out
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


def test_a_lens_becomes_a_preset_beside_its_table(cli, tmp_path, no_bar):
    outcome = cli("lens", "preset", "biconvex", "-o", tmp_path / "mine.toml")
    assert (outcome.code, outcome.err) == (0, "")
    assert re.search(r"points match traced ones by 0\.9\d+", outcome.out)
    assert 'aberration-table = "mine.csv"' in (tmp_path / "mine.toml").read_text()
    write_image(tmp_path / "in.png", np.full((16, 16, 3), 0.5, np.float32))
    taken = cli(
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
    assert taken.code == 0, taken.err


def test_a_transfer_function_is_stored_and_is_a_lens_then(cli, tmp_path):
    outcome = cli("lens", "transfer", "petzval", "--one-colour", "-o", tmp_path / "a.npz")
    assert (outcome.code, outcome.err) == (0, "")
    assert re.search(r"0\.7 to 1\.0 +0\.0\d+ +0\.0\d+", outcome.out)
    shown = cli("lens", tmp_path / "a.npz")
    assert shown.code == 0
    assert "99.98" in shown.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
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

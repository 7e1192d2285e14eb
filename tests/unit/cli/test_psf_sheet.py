"""``bokehnet lens NAME --psf-sheet``."""

import re

import numpy as np
import pytest

from bokehnet.io.image import read_image
from bokehnet.lenses.aberrations import psf_pairs as pairs_module
from bokehnet.tools import psf_sheet


@pytest.fixture
def quick(monkeypatch):
    """Few rays."""
    monkeypatch.setattr(
        psf_sheet, "psf_pairs", lambda lens: pairs_module.psf_pairs(lens, aberration_map=None, rays=2000)
    )


@pytest.mark.slow
def test_the_sheet_shows_traced_and_reduced_side_by_side(cli, tmp_path, quick):
    out = tmp_path / "sheet.png"
    outcome = cli("lens", "biconvex", "--focus", 2, "--f-number", 11, "--psf-sheet", out)
    assert outcome.code == 0, outcome.err
    match = re.search(
        r"blur of points +modelled against traced: correlation (0\.\d+), worst (0\.\d+)", outcome.out
    )
    assert match is not None
    assert 0.75 < float(match[2]) <= float(match[1]) <= 1
    sheet = read_image(out)
    side, gap, strip, between = 256, 12, 34, 6
    assert sheet.shape == (gap + 3 * (side + strip + gap), gap + 3 * (2 * side + between + gap), 3)
    for row in range(3):
        for column in range(3):
            top, left = gap + row * (side + strip + gap), gap + column * (2 * side + between + gap)
            traced = sheet[top : top + side, left : left + side]
            reduced = sheet[top : top + side, left + side + between : left + 2 * side + between]
            assert traced.max() > 0.5
            equal = (traced * reduced).sum() / np.sqrt((traced**2).sum() * (reduced**2).sum())
            assert equal > 0.7


@pytest.mark.parametrize("name", ["nowhere/out.png", "sheet.psd"])
def test_a_file_that_cannot_be_written_is_reported_first(cli, tmp_path, name):
    outcome = cli("lens", "biconvex", "--psf-sheet", tmp_path / name)
    assert outcome.code == 1
    assert outcome.err.startswith("bokehnet: error: ")
    assert outcome.err.count("\n") == 1


def test_it_needs_a_lens(cli, tmp_path):
    outcome = cli("lens", "--psf-sheet", tmp_path / "out.png")
    assert (outcome.code, outcome.out) == (1, "")
    assert "NAME: expected a lens or a TOML file" in outcome.err

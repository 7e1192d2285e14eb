"""Tables of the documentation agree with the figures that benchmark commands wrote."""

import json

import pytest

from tools.figures import FIGURES, PAGES, filled

FILES = sorted(FIGURES.glob("*.json"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tables_agree_with_their_figures(page):
    text = page.read_text(encoding="utf-8")
    assert filled(text) == text, f"python -m tools.figures writes {page.name} anew"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_figures_name_their_command_commit_and_conditions(path):
    figures = json.loads(path.read_text(encoding="utf-8"))
    assert all(figures[key] for key in ("command", "commit", "conditions", "columns", "rows"))
    columns = set(figures["columns"])  # a row may lack what was not measured
    assert all(row and set(row) <= columns for row in figures["rows"].values())
    assert all(any(key in row for row in figures["rows"].values()) for key in columns)
    assert any(f"<!-- figures: {path.stem}" in page.read_text(encoding="utf-8") for page in PAGES)


def test_a_changed_number_is_noticed(tmp_path):
    page = "<!-- figures: NAME -->\n| a | 1 |\n<!-- end figures -->\n"
    for path in FILES[:1]:
        text = page.replace("NAME", path.stem)
        assert filled(text) != text
        assert filled(filled(text)) == filled(text)

"""Search of the documentation, on pages that are opened from the disk."""

import subprocess
import sys

import pytest

from .conftest import ROOT, until


@pytest.mark.slow
@pytest.mark.parametrize("start", ["index.html", "use/photo.html"])
def test_a_search_finds_its_page_without_a_server(browser, site, start):
    page = browser.new_page()
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto((site / start).as_uri())
    page.locator("input.md-search__input").click()
    page.keyboard.type("cat's-eye")
    until(page, "document.querySelectorAll('.md-search-result__link').length > 0")
    links = page.evaluate("[...document.querySelectorAll('.md-search-result__link')].map(link => link.href)")
    assert any("use/shapes.html" in link for link in links)
    assert all(address.startswith("file:") for address in requests)
    page.close()


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the built documentation."""
    pytest.importorskip("material", reason="needs mkdocs-material: pip install '.[docs]'")
    pytest.importorskip("mkdocstrings", reason="needs mkdocstrings: pip install '.[docs]'")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True)
    return folder

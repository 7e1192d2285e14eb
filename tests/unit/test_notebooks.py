"""The notebooks run from top to bottom, and are kept without what they show."""

import json
import time

import pytest

from tests.conftest import ROOT

NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))


def test_there_are_some():
    assert len(NOTEBOOKS) >= 5


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_kept_without_results(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in cells if "outputs" in cell)
    assert path.stat().st_size < 20_000


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs(path, tmp_path, monkeypatch):
    nbformat = pytest.importorskip("nbformat", reason="runs notebooks: pip install nbclient ipykernel")
    nbclient = pytest.importorskip("nbclient", reason="runs notebooks: pip install nbclient ipykernel")
    pytest.importorskip("ipykernel", reason="runs notebooks: pip install nbclient ipykernel")
    pytest.importorskip("anywidget", reason="needs the extra notebook")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.read(path, as_version=4)
    begun = time.perf_counter()
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert time.perf_counter() - begun < 120
    shown = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert any(output["output_type"] in ("stream", "execute_result") for output in shown)
    pictures = [data for output in shown if "<img" in (data := output.get("data", {}).get("text/html", ""))]
    assert bool(pictures) == (path.stem in ("start", "lens_looks", "compare_methods"))

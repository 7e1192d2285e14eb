"""Releases are complete and consistent. Authority: git's list of files."""

import re
import subprocess
import sys
import tarfile

import pytest

from tests.conftest import ROOT
from tools import release


def test_every_file_has_the_same_version():
    assert len(set(release.stated_versions().values())) == 1
    assert release.check_versions() == release.stated_versions()["bokehnet/version.py"]


def test_a_version_that_disagrees_is_reported(monkeypatch):
    monkeypatch.setattr(release, "stated_versions", lambda: {"a": "1.0", "b": "1.1"})
    with pytest.raises(SystemExit, match=r"expected one version, found a 1\.0, b 1\.1"):
        release.check_versions()


@pytest.mark.slow
def test_the_sdist_holds_every_file_of_the_repository(tmp_path):
    pytest.importorskip("hatchling", reason="builds with hatchling, which the extra release brings")
    if not (ROOT / ".git").exists():
        pytest.skip("needs git's list of files")
    code = "import sys; from hatchling.builders.sdist import SdistBuilder"
    code += "; next(SdistBuilder('.').build(directory=sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    with tarfile.open(next(tmp_path.glob("*.tar.gz"))) as file:
        there = {name.partition("/")[2] for name in file.getnames()}
    assert sorted(release.released_files() - there) == []


def test_a_file_that_is_missing_is_reported(tmp_path, monkeypatch):
    empty = tmp_path / "a.tar.gz"
    with tarfile.open(empty, "w:gz"):
        pass
    monkeypatch.setattr(release, "released_files", lambda: {"bokehnet/version.py"})
    with pytest.raises(SystemExit, match=r"1 missing: \['bokehnet/version.py'\]"):
        release.check_contents(empty, tmp_path / "none.whl")


def test_networks_without_pins_are_listed_and_can_be_an_error(tmp_path, monkeypatch):
    assert "unidepth-v2-small" not in release.unpinned_models()  # nobody publishes it
    monkeypatch.setattr(release, "unpinned_models", lambda: ["depth-pro"])
    monkeypatch.setattr(sys, "argv", ["release", "--out", str(tmp_path), "--pinned"])
    with pytest.raises(SystemExit, match=r"expected pins, found none of depth-pro; run tools\.pin_models"):
        release.main()
    assert not list(tmp_path.iterdir())


def test_the_pages_files_are_those_that_the_bundle_names():
    there = {path.name for path in (ROOT / "web").iterdir()}
    assert set(release.WEB) <= there
    linked = (ROOT / "web/index.html").read_text(encoding="utf-8")
    linked += "".join((ROOT / f"web/{name}").read_text(encoding="utf-8") for name in release.WEB[1:4])
    expected = set(re.findall(r"\"(?:\./)?([\w-]+\.js)\"", linked))
    assert expected <= set(release.WEB)
    assert {"page.js", "worker.js", "bokeh.js"} <= expected

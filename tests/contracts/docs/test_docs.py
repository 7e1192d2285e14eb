"""Everything that the documentation shows exists, and its site builds without a warning."""

import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import bokehnet
from bokehnet.baselines import BASELINES
from bokehnet.cli.app import app
from tests.conftest import ROOT

PAGES = sorted((ROOT / "docs").rglob("*.md"))
SHELL = re.compile(r"```sh\n(.*?)```", re.DOTALL)


def command_lines(text: str) -> list[list[str]]:
    """Words of every command of the ``sh`` blocks; && parts two commands, ... leaves something out."""
    lines = [
        line
        for block in SHELL.findall(text)
        for line in block.replace("\\\n", " ").splitlines()
        if not line.startswith(("#", "..."))
    ]
    words = [shlex.split(part, comments=True) for line in lines for part in line.split("&&")]
    return [command for command in words if command]


# Path of a page below docs -> its commands, and the modules that it runs.
TEXTS = {str(page.relative_to(ROOT / "docs")): page.read_text(encoding="utf-8") for page in PAGES}
COMMANDS = {
    page: [words[1:] for words in command_lines(text) if words[0] == "bokehnet"]
    for page, text in TEXTS.items()
}
MODULES = {
    page: set(re.findall(r"python\s+-m\s+((?:bokehnet|train|benchmarks|tools)[\w.]*)", text))
    for page, text in TEXTS.items()
}


def parse(words: list[str]) -> None:
    """Parse a command line as the program does, without running it; the shell's > is not its own."""
    words = words[: words.index(">")] if ">" in words else words
    command = app.commands[words[0]]
    command.make_context(f"bokehnet {words[0]}", list(words[1:]))


@pytest.mark.parametrize("page", [page for page in COMMANDS if COMMANDS[page]])
def test_every_bokehnet_command_parses(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.toml").write_text("cats-eye = 0.5\n", encoding="utf-8")  # the preset of one's own
    for words in COMMANDS[page]:
        try:
            parse(words)
        except Exception as error:
            pytest.fail(f"bokehnet {shlex.join(words)}: {error}")


def test_a_command_with_an_unknown_option_does_not_parse():
    with pytest.raises(Exception, match="--blurr"):
        parse(["render", "photo.jpg", "--blurr", "40", "-o", "out.png"])


@pytest.mark.parametrize("page", [page for page in MODULES if MODULES[page]])
def test_every_module_that_is_run_exists(page):
    assert [name for name in sorted(MODULES[page]) if importlib.util.find_spec(name) is None] == []


def test_every_public_name_is_in_the_api_pages():
    """By itself or with its whole module, in one of the pages of the API."""
    pages = sorted((ROOT / "docs/use/api").glob("*.md"))
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    documented = set(re.findall(r"^::: ([\w.]+)$", text, re.MULTILINE))
    homes = {name: getattr(bokehnet, name).__module__ for name in bokehnet.__all__ if name != "__version__"}
    assert [name for name, home in homes.items() if not documented & {home, f"{home}.{name}"}] == []


def test_every_file_of_the_repository_that_a_page_names_exists():
    """By its whole path or the end of it; folders of results and of the user are not in the repository."""
    named = re.compile(r"`(\w[\w./-]*/[\w-]+\.(?:py|toml|json|js|md|html|cpp)|\w+\.py)`")
    folders = [path for path in ROOT.iterdir() if path.is_dir() and path.name[0] != "."]
    paths = [*ROOT.glob("*.*"), *(path for folder in folders for path in folder.rglob("*.*"))]
    files = [f"/{path.relative_to(ROOT).as_posix()}" for path in paths]
    missing = [
        (page, name)
        for page, text in TEXTS.items()
        for name in named.findall(text)
        if not name.startswith("runs/") and "NAME" not in name
        if not any(file.endswith(f"/{name}") for file in files)
    ]
    assert missing == []


def test_the_number_of_methods_of_the_literature_is_that_of_the_registry():
    texts = [*TEXTS.values(), (ROOT / "README.md").read_text(encoding="utf-8")]
    counts = [count for text in texts for count in re.findall(r"(\S+) \[?methods of the literature", text)]
    assert {int(count) for count in counts if count.isdecimal()} == {len(BASELINES)}


def test_every_page_is_in_the_navigation():
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert [page.name for page in PAGES if str(page.relative_to(ROOT / "docs")) not in text] == []


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path):
    for module, package in (
        ("mkdocs", "mkdocs"),
        ("material", "mkdocs-material"),
        ("mkdocstrings", "mkdocstrings"),
    ):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"needs {package}: pip install '.[docs]'")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "path-traced" in (tmp_path / "develop/benchmarks.html").read_text(encoding="utf-8")
    assert "cats_eye" in (tmp_path / "use/api/classical.html").read_text(encoding="utf-8")

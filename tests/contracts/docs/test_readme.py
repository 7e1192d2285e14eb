"""Commands and names of the README exist."""

import importlib.util
import re
import shlex
from pathlib import Path

import pytest

from tests.conftest import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```sh\n(.*?)```", README, flags=re.DOTALL)
LINES = [line for block in BLOCKS for line in block.replace("\\\n", " ").splitlines() if line.strip()]
COMMANDS = [shlex.split(line, comments=True) for line in LINES if not line.startswith("#")]


def options_of(words: list[str]) -> set[str]:
    return {word.split("=")[0] for word in words if word.startswith("-") and len(word) > 1}


@pytest.mark.parametrize("words", [w for w in COMMANDS if w[0] == "bokehnet"], ids=" ".join)
def test_every_option_of_a_bokehnet_command_is_known(words, cli):
    result = cli(words[1], "--help-all" if words[1] in ("render", "compare", "studio") else "--help")
    assert result.code == 0
    for option in options_of(words[2:]):
        assert re.search(rf"(?<![\w-]){re.escape(option)}(?![\w-])", result.out), option


@pytest.mark.parametrize("words", [w for w in COMMANDS if w[:2] == ["python", "-m"]], ids=" ".join)
def test_every_module_and_config_exists(words):
    assert importlib.util.find_spec(words[2]) is not None
    for name in words:
        if name.startswith("configs/"):
            assert (ROOT / name).is_file()


def test_every_file_the_map_names_exists():
    """Names in back quotes that look like paths; `a.py`, `b.py` after a folder belong to that folder."""
    for row in re.findall(r"^\|.*\| (.*) \|$", README, flags=re.MULTILINE)[2:]:
        folder = Path()
        for name in re.findall(r"`([\w/.*]+)`", row):
            result = list(ROOT.glob(name)) or list(ROOT.glob(str(folder / name)))
            assert result, name
            folder = Path(name).parent if "/" in name else folder


def test_ci_runs_the_two_set_up_commands():
    """From one wheel, which ``pip install .`` would build for each of them."""
    script = (ROOT / ".ci/run").read_text(encoding="utf-8")
    assert ["pip", "install", ".", "&&", "bokehnet", "demo"] in COMMANDS
    assert ["pip", "install", "-c", "constraints.txt", ".[dev]", "&&", "pytest", "-n", "2"] in COMMANDS
    assert 'pip" wheel -q --no-deps -w "$work/wheel" .' in script
    assert 'install -q -c constraints.txt "$wheel[dev]"' in script
    assert 'pytest" --all -n 2' in script
    assert 'install -q "$wheel"' in script


def test_links_to_files_of_the_repository_work():
    for target in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT / target).is_file(), target

"""Scripts whose package lacks an extra end in one line, in a process of their own."""

import ast
import os
import re
import subprocess
import sys
import tomllib

import pytest

from tests.conftest import ROOT
from train.missing_packages import _EXTRAS

# Modules whose package has another name; libraries to compare with, which no extra has.
PACKAGES = {"PIL": "pillow", "skimage": "scikit-image", "flip_evaluator": "flip-evaluator"}
PACKAGES |= {"pytorch_msssim": "pytorch-msssim", "prometheus_client": "prometheus-client"}
RIVALS = {"OpenEXR", "halide", "optiland", "rayoptics"}

EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def packages(requirements):
    return {re.match(r"[\w.-]+", text)[0].lower() for text in requirements}


def imported_modules(folder):
    """Return the first names of all modules that the files of a folder import, at the top or in functions."""
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from (alias.name.split(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and not node.level:
                yield node.module.split(".")[0]


@pytest.fixture
def without(tmp_path):
    """Return a function that returns the environment of a process in which a module cannot be imported."""

    def environment(module):
        (tmp_path / "sitecustomize.py").write_text(f"import sys\nsys.modules[{module!r}] = None\n")
        return {**os.environ, "PYTHONPATH": str(tmp_path)}

    return environment


def check_one_line(words, environment, line):
    done = subprocess.run(
        [sys.executable, "-m", *words],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"error: this needs {line}\n"


@pytest.mark.parametrize(
    "script", ["train.recipe", "train.export", "train.train_arnet", "benchmarks.experiments.theses.marsicano"]
)
def test_a_script_without_torch_names_the_extra(without, script):
    check_one_line([script, "--help"], without("torch"), "torch: pip install 'bokehnet[train]'")


def test_export_without_onnx_names_the_extra(without):
    check_one_line(["train.export", "--help"], without("onnx"), "onnx: pip install 'bokehnet[train]'")


def test_plots_without_matplotlib_name_the_extra(without, tmp_path):
    words = ["benchmarks.plots", "docs/figures/growth_radius.json", str(tmp_path / "plot.svg")]
    check_one_line(words, without("matplotlib"), "matplotlib: pip install 'bokehnet[plot]'")


def test_every_optional_module_of_the_scripts_has_its_extra():
    base = packages(EXTRAS["dependencies"])
    own = {path.name.removesuffix(".py") for path in ROOT.iterdir()} | {"bokeh_bench"}
    imported = {name for folder in ("train", "benchmarks") for name in imported_modules(folder)}
    optional = imported - own - base - set(sys.stdlib_module_names) - {"OpenImageIO"} - RIVALS
    assert sorted(optional - _EXTRAS.keys()) == []


@pytest.mark.parametrize("module", sorted(_EXTRAS))
def test_the_extra_has_the_package(module):
    extra = EXTRAS["optional-dependencies"][_EXTRAS[module]]
    name = PACKAGES.get(module, module)
    assert name in packages(text.replace("ray[train]", "ray") for text in extra)

"""Kernels of the default paths are compiled ahead: the list of signatures has every one that Python calls."""

import ast
import re
from functools import cache
from pathlib import Path

from tools.kernel_library import read_signatures

PACKAGE = Path(__file__).parents[3] / "bokehnet"
ROOMS = (
    "arrays",
    "classical",
    "depth_repair",
    "effects",
    "light",
    "onnx_file",
    "optics",
    "scene",
    "sequence",
)

# Adjoints and spans, which torch needs, and the surfaces of `trace --method peeled`: the first call compiles.
WITH_TORCH = {
    "aperture_scatter.shaped_backward",
    "disc_scatter.gather_discs",
    "disc_scatter.sum_from_end",
    "pixel_layers._merge",
    "pyramid_lattices.gather_lattice",
    "pyramid_merging.halve_gradient",
    "pyramid_merging.split_gradients",
    "scanline_spans._list_disc",
}


def decorated(node: ast.AST, words: tuple[str, ...]) -> bool:
    """Return whether a decorator of a function contains one of some words."""
    decorators = getattr(node, "decorator_list", [])
    return any(word in ast.unparse(decorator) for decorator in decorators for word in words)


@cache
def body_of(path: Path) -> list[ast.stmt]:
    return ast.parse(path.read_text(encoding="utf-8")).body


def kernels_of(path: Path) -> set[str]:
    """Return the names of the kernels of a module."""
    return {
        node.name
        for node in body_of(path)
        if isinstance(node, ast.FunctionDef) and decorated(node, ("njit",))
    }


def called_kernels(path: Path) -> set[str]:
    """Return the kernels that the Python functions of a module call, as MODULE.KERNEL."""
    kernels = {name: f"{path.stem}.{name}" for name in kernels_of(path)}
    for node in body_of(path):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("bokehnet."):
            source = PACKAGE.parent / f"{str(node.module).replace('.', '/')}.py"
            imported = {item.name for item in node.names} & (kernels_of(source) if source.exists() else set())
            kernels |= {name: f"{source.stem}.{name}" for name in imported}
    called = {
        call.func.id
        for node in body_of(path)
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        and not decorated(node, ("jit", "intrinsic", "overload"))
        for call in ast.walk(node)
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)
    }
    return {full for name, full in kernels.items() if name in called}


def test_kernels_that_python_calls_are_listed():
    paths = [path for room in ROOMS for path in (PACKAGE / room).rglob("*.py")]
    called = {name for path in paths for name in called_kernels(path)}
    assert len(called) > 40
    assert called - {name for name, _ in read_signatures()} == WITH_TORCH


def test_listed_arguments_fit_the_kernels():
    """A kernel whose parameters changed is compiled ahead only if its line changes with it."""
    functions = {
        f"{path.stem}.{node.name}": node.args
        for path in PACKAGE.rglob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef) and decorated(node, ("njit",))
    }
    listed = read_signatures()
    assert len(listed) > 100
    for name, description in listed:
        call = ast.parse("f" + re.sub(r"\[\w+\]", "", description), mode="eval").body
        count, parameters = len(call.args), functions[name]
        most = len(parameters.args)
        assert most - len(parameters.defaults) <= count <= most, f"{name}: {count} arguments are listed"

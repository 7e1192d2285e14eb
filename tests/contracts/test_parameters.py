"""Functions are short: at most 80 lines, and seven parameters or a reason in the documentation."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
MAX_PARAMETERS, MAX_LINES = 7, 80
ROW = re.compile(r"^\| `([\w/]+\.py)` \| `([\w.]+)` \| (\d+) \| .+ \|$", re.MULTILINE)


def long_functions(tree: ast.AST, owner: str = "") -> Iterator[tuple[str, int]]:
    """Yield name and number of parameters of the public functions above the limit, except kernels."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from long_functions(node, f"{node.name}.")
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not node.name.startswith("_"):
            names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
            count = len([name for name in names if name not in ("self", "cls")])
            is_kernel = any("njit" in ast.unparse(decorator) for decorator in node.decorator_list)
            if count > MAX_PARAMETERS and not is_kernel:
                yield owner + node.name, count


def test_exceptions_are_those_of_the_documentation():
    page = (ROOT / "docs/develop/changing.md").read_text(encoding="utf-8")
    listed = {(path, name): int(count) for path, name, count in ROW.findall(page)}
    results = {
        (str(path.relative_to(ROOT)), name): count
        for folder in ("bokehnet", "train")
        for path in sorted((ROOT / folder).rglob("*.py"))
        for name, count in long_functions(ast.parse(path.read_text(encoding="utf-8")))
    }
    assert results == listed


def holds_a_kernel(node: ast.AST) -> bool:
    """Return whether a function is a kernel, or makes one."""
    return any(
        "jit" in ast.unparse(decorator)
        for function in ast.walk(node)
        if isinstance(function, ast.FunctionDef)
        for decorator in function.decorator_list
    )


def test_no_function_but_kernels_has_more_than_80_lines():
    long = [
        (str(path.relative_to(ROOT)), node.name)
        for folder in ("bokehnet", "train")
        for path in sorted((ROOT / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (node.end_lineno or 0) - node.lineno + 1 > MAX_LINES
        and not holds_a_kernel(node)
    ]
    assert long == []

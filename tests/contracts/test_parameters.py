"""Public functions have at most seven parameters; the documentation lists the exceptions with reasons."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
MAX_PARAMETERS = 7
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

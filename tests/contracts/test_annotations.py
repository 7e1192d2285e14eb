"""Every function of the package has types, except kernels, which numba types by their calls."""

import ast
from pathlib import Path

import bokehnet

PACKAGE = Path(bokehnet.__file__).parent
COMPILERS = ("njit", "cuda.jit", "intrinsic", "overload", "vectorize")


def untyped(path: Path) -> list[str]:
    """Return the functions of a file that lack types and are no kernels."""
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        decorators = " ".join(ast.unparse(decorator) for decorator in node.decorator_list)
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        lacking = [a.arg for a in arguments if a.annotation is None and a.arg not in ("self", "cls")]
        has_result = node.returns is not None or node.name == "__init__"
        if (lacking or not has_result) and not any(word in decorators for word in COMPILERS):
            names.append(f"{path.relative_to(PACKAGE)}:{node.lineno} {node.name}")
    return names


def test_only_kernels_lack_types():
    assert [name for path in sorted(PACKAGE.rglob("*.py")) for name in untyped(path)] == []


def test_the_check_finds_a_function_without_types(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.contracts.test_annotations.PACKAGE", tmp_path)
    text = "def f(x): pass\n@njit(cache=True)\ndef g(x): pass\ndef h(x: int) -> int: return x\n"
    (tmp_path / "a.py").write_text(text, encoding="utf-8")
    assert untyped(tmp_path / "a.py") == ["a.py:1 f"]

"""Each public class and function of the rendering room has an example in its docstring, and it runs."""

import doctest
import importlib
import inspect
import pkgutil

import pytest

from bokehnet import rendering

MODULES = sorted(f"bokehnet.rendering.{found.name}" for found in pkgutil.iter_modules(rendering.__path__))


def public(module_name: str) -> list:
    module = importlib.import_module(module_name)
    found = [getattr(module, name) for name in module.__all__]
    return [item for item in found if inspect.isclass(item) or inspect.isfunction(item)]


OWN = [
    pytest.param(item, id=f"{name.rsplit('.', 1)[1]}.{item.__name__}")
    for name in MODULES
    for item in public(name)
    if item.__module__ == name
]


@pytest.mark.parametrize("item", OWN)
def test_it_has_an_example(item):
    assert ">>> " in (item.__doc__ or "")


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_say_what_comes_out(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    result = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    assert result.failed == 0

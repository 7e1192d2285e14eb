"""Docstring examples of all public classes and functions from settings to sequences."""

import doctest
import importlib
import inspect
import pkgutil

import pytest

from bokehnet import render, scene, sequence, settings

# Steps of a shot and of the search for a subject that no user calls.
INTERNAL = {
    *(
        f"bokehnet.sequence.{name}"
        for name in ("filtered_shot", "optical_flow", "resumable_folder", "temporal_filter")
    ),
    *(f"bokehnet.scene.subject.{name}" for name in ("candidates", "masks", "view")),
}

MODULES = sorted(
    name
    for package in (render, scene, sequence, settings)
    for _, name, is_package in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    if not is_package and name not in INTERNAL
)


def public(module_name: str) -> list:
    module = importlib.import_module(module_name)
    named = [getattr(module, name) for name in module.__all__]
    return [item for item in named if inspect.isclass(item) or inspect.isfunction(item)]


@pytest.mark.parametrize("name", MODULES)
def test_docstrings_have_examples_and_they_say_what_comes_out(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own = [item for item in public(name) if item.__module__ == name]
    assert [item.__name__ for item in own if ">>> " not in (item.__doc__ or "")] == []
    module = importlib.import_module(name)
    result = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    assert result.failed == 0

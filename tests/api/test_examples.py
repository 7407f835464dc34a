"""The examples in the docstrings do what they say."""

from __future__ import annotations

import doctest
import importlib
import inspect

import pytest

import rsenf
from tests.house import modules

WITH_EXAMPLES = sorted(
    name
    for name, path in modules().items()
    if ">>> " in path.read_text(encoding="utf-8") and name not in ("rsenf", "rsenf.api")
    if not name.startswith("rsenf.api.")
)


@pytest.mark.parametrize("name", sorted(rsenf.__all__))
def test_example(name: str) -> None:
    function = inspect.unwrap(getattr(rsenf, name))
    module = importlib.import_module(function.__module__)
    (example,) = doctest.DocTestFinder(recurse=False).find(function, name, module, globs={})
    assert example.examples, f"{name} has no example"
    assert doctest.DocTestRunner().run(example).failed == 0


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_of_a_module(name: str) -> None:
    module = importlib.import_module(name)
    tried = doctest.testmod(module)
    assert tried.attempted
    assert tried.failed == 0

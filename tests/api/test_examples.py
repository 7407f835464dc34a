"""The examples in the docstrings do what they say."""

from __future__ import annotations

import doctest
import importlib
import inspect

import pytest

import rsenf


@pytest.mark.parametrize("name", sorted(rsenf.__all__))
def test_example(name: str) -> None:
    function = inspect.unwrap(getattr(rsenf, name))
    module = importlib.import_module(function.__module__)
    (example,) = doctest.DocTestFinder(recurse=False).find(function, name, module, globs={})
    assert example.examples, f"{name} has no example"
    assert doctest.DocTestRunner().run(example).failed == 0

"""``rsenf.track`` and the others are functions, whatever was imported before; nothing is heavy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import rsenf

SHARED = ("track", "idle", "live")  # names of a function and of a room


def python(program: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", SHARED)
@pytest.mark.parametrize(
    "order",
    [
        "import rsenf.{name}.settings; import rsenf; f = rsenf.{name}",
        "import rsenf; f = rsenf.{name}; import rsenf.{name}.settings; assert rsenf.{name} is f",
        "import importlib; importlib.import_module('rsenf.{name}'); from rsenf import {name} as f",
    ],
)
def test_a_function_whatever_came_first(name: str, order: str) -> None:
    program = order.format(name=name) + f"\nimport rsenf.{name}\nassert f is rsenf.{name}"
    assert python(f"{program}\nprint(f.__module__, f.__name__)") == f"rsenf.api.{name} {name}\n"


def test_rooms_are_imported_from_as_ever() -> None:
    program = (
        "import rsenf; rsenf.track; rsenf.idle; rsenf.live\n"
        "from rsenf.track import METHODS\n"
        "from rsenf.idle import METHODS as idle_methods\n"
        "from rsenf.live import Live\n"
        "from rsenf.track.stft import StftTracker\n"
        "print('stft' in METHODS, 'coherent' in idle_methods, Live.__name__)"
    )
    assert python(program) == "True True Live\n"


def test_nothing_is_imported_before_it_is_asked_for() -> None:
    heavy = "{'numpy', 'argparse', 'importlib.metadata', 'rsenf.api'} & set(sys.modules)"
    assert python(f"import rsenf, sys; print(rsenf.__version__, {heavy})").endswith("set()\n")


def test_all_that_is_said_to_be_there_is() -> None:
    assert set(rsenf.__all__) <= set(dir(rsenf))
    assert all(callable(getattr(rsenf, name)) for name in rsenf.__all__)
    with pytest.raises(AttributeError, match="no attribute 'trak'"):
        _ = rsenf.trak


def test_it_is_marked_as_typed() -> None:
    assert (Path(rsenf.__file__).parent / "py.typed").is_file()

"""``rsenf.track`` and the others are functions, whatever was imported before; nothing is heavy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import rsenf

MODULE = {"track": "method", "idle": "refusals", "live": "settings"}  # one of each room
SHARED = tuple(MODULE)  # names of a function and of a room


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
        "import rsenf.{name}.{module}; import rsenf; f = rsenf.{name}",
        "import rsenf; f = rsenf.{name}; import rsenf.{name}.{module}; assert rsenf.{name} is f",
        "import importlib; importlib.import_module('rsenf.{name}'); from rsenf import {name} as f",
        "import rsenf.{name}.{module} as s; import rsenf.{name} as f; assert s is f.{module}",
    ],
)
def test_a_function_and_a_room_whatever_came_first(name: str, order: str) -> None:
    program = (
        order.format(name=name, module=MODULE[name])
        + f"\nimport rsenf.{name}\nassert f is rsenf.{name}"
    )
    program += "\nimport inspect; g = inspect.unwrap(f); assert 'Examples' in f.__doc__"
    program += "\nassert 'recording' in inspect.signature(f).parameters"
    assert python(f"{program}\nprint(g.__module__, g.__name__)") == f"rsenf.api.{name} {name}\n"


def test_it_is_called_as_the_function() -> None:
    program = (
        "import numpy as np, rsenf; print(rsenf.track(np.ones(90), frame_rate_hz=30.0).summary)"
    )
    assert "no usable signal" in python(program)


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

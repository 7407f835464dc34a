"""What a recording says of the processor: which instruction sets are in use, not which it has."""

from __future__ import annotations

import os
import subprocess
import sys

from numpy._core import _multiarray_umath as core

from rsenf.record.provenance import program_facts
from tests.older_processor import CORE, OFF, variables

TELL = "from rsenf.record.provenance import program_facts; print(program_facts()['arithmetic'])"


def arithmetic(first: str = "", **environment: str) -> list[str]:
    """What another process says of itself, with ``first`` loaded before."""
    told = subprocess.run(
        [sys.executable, "-c", f"{first}\n{TELL}"], env={**os.environ, **environment},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return told.stdout.split()


def test_every_process_of_an_environment_says_the_same() -> None:
    assert " ".join(arithmetic()) == program_facts()["arithmetic"]


def test_libraries_with_an_openblas_of_their_own_change_nothing() -> None:
    for first in ("import cv2", "import scipy.linalg", "import cv2, scipy.linalg"):
        assert arithmetic(first) == arithmetic(), first


def test_what_numpy_is_told_to_leave_is_not_in_it() -> None:
    older = variables()
    here, there = arithmetic(), arithmetic(**{OFF: older[OFF]})
    assert set(here) - set(there) == set(older[OFF].split(",")) & set(here)


def test_a_processor_with_nothing_beyond_the_baseline_has_a_name_too() -> None:
    every = {name for name, here in core.__cpu_features__.items() if here}
    off = [name for name in core.__cpu_dispatch__ if name in every]
    assert not set(off) & set(arithmetic(**{OFF: ",".join([*off, os.environ.get(OFF, "")])}))


def test_it_names_the_processor_that_openblas_takes_this_for() -> None:
    cores = {"Haswell", "Nehalem"}
    assert {c for c in cores if c in arithmetic(**{CORE: c})} == cores

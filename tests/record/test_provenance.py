"""What a recording says of the processor: which instruction sets are in use, not which it has."""

from __future__ import annotations

import os
import subprocess
import sys

from rsenf.record.provenance import program_facts
from tests.older_processor import CORE, OFF, variables

TELL = "from rsenf.record.provenance import program_facts; print(program_facts()['arithmetic'])"


def arithmetic(**environment: str) -> list[str]:
    """What another process says of itself."""
    told = subprocess.run(
        [sys.executable, "-c", TELL], env={**os.environ, **environment}, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    return told.stdout.split()


def test_every_process_of_an_environment_says_the_same() -> None:
    assert " ".join(arithmetic()) == program_facts()["arithmetic"]


def test_what_numpy_is_told_to_leave_is_not_in_it() -> None:
    older = variables()
    here, there = arithmetic(), arithmetic(**{OFF: older[OFF]})
    assert set(here) - set(there) == set(older[OFF].split(",")) & set(here)


def test_it_names_the_processor_that_openblas_takes_this_for() -> None:
    cores = {"Haswell", "Nehalem"}
    assert {c for c in cores if c in arithmetic(**{CORE: c})} == cores

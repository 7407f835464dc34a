"""The heap: what was freed is taken again, without asking the system for every page."""

from __future__ import annotations

import resource
import subprocess
import sys

import pytest

WORK = """
import resource
from rsenf.run.heap import keep_heap
{keep}
def faults():
    for _ in range(50):
        bytes(bytearray(1 << 20))
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
first = faults()
print(faults() - first)
"""


def _faults(keep: str) -> int:
    words = [sys.executable, "-c", WORK.format(keep=keep)]
    return int(subprocess.run(words, capture_output=True, check=True, text=True).stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's heap")
def test_blocks_that_were_freed_are_taken_again() -> None:
    pages = (1 << 20) // resource.getpagesize()
    assert _faults("keep_heap()") < pages / 4

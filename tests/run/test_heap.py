"""The heap: what was freed is taken again without asking the system for every page, for a while."""

from __future__ import annotations

import resource
import subprocess
import sys

import pytest

WORK = """
import resource
from rsenf.run.process import keep_heap
{keep}
def faults():
    for _ in range(50):
        bytes(bytearray(1 << 20))
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
first = faults()
print(faults() - first)
"""

HOLES = """
import resource
from rsenf.run.process import keep_heap, trim_heap
keep_heap()
def resident_kb():
    return int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize() // 1024
blocks = [bytes(bytearray(20_000)) for _ in range(3000)]
del blocks[::2]
before_kb = resident_kb()
trim_heap()
print(before_kb - resident_kb())
"""


def _faults(keep: str) -> int:
    words = [sys.executable, "-c", WORK.format(keep=keep)]
    return int(subprocess.run(words, capture_output=True, check=True, text=True).stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's heap")
def test_blocks_that_were_freed_are_taken_again() -> None:
    pages = (1 << 20) // resource.getpagesize()
    assert _faults("keep_heap()") < pages / 4


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's heap")
def test_what_lies_free_between_others_goes_back() -> None:
    words = [sys.executable, "-c", HOLES]
    freed_kb = int(subprocess.run(words, capture_output=True, check=True, text=True).stdout)
    assert freed_kb > 15_000  # of 30 MB

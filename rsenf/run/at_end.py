"""The end of a process that has been on the bus."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import NoReturn


def end_process(code: int) -> NoReturn:
    """End now, once everything is closed.

    Left to itself, the interpreter would still take apart Zenoh's objects while Zenoh's threads
    may ask for it: of a hundred nodes one waited for ever.

    Parameters
    ----------
    code : int
        The exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()
    os._exit(code)

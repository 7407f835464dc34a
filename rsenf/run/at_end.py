"""Ends a process that has used Zenoh."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import NoReturn


def end_process(code: int) -> NoReturn:
    """Flush stdout and stderr and exit at once. Call it after everything is closed.

    A normal exit can deadlock: the interpreter destroys Zenoh's objects while Zenoh's threads may
    still need the interpreter. One node in a hundred hung for ever.

    Parameters
    ----------
    code : int
        The exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()
    os._exit(code)

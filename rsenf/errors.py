"""The tree of errors; each has an exit code, and may have a hint.

::

    RsenfError                 1
    ├── UsageError             2   the command or its arguments are invalid
    │   ├── ConfigError        2   a graph or model file; lists every problem with file:line
    │   ├── ParameterError     2   a parameter of the capture model (rsenf.model.parameters)
    │   └── ReferenceFormatError 2 a file that isn't a grid reference
    ├── InputError             1   a recording that contains nothing usable
    │   └── NoSignal           1   a readable recording without flicker
    ├── SourceLost             1   a live source that can't be reached
    ├── RecordingError         1   a recording can't be written (disk full, no rights)
    ├── NodeFailed             1   a process of a graph failed
    └── SchemaMismatch         1   bytes that don't match their declared message or version

Exit code 3, "done with loss", is no error: the work was done, and the result says what was lost.
Exit code 130 is an interruption by the user.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

EXIT_DONE = 0
EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_LOSS = 3
EXIT_INTERRUPTED = 130


class RsenfError(Exception):
    """Base class of all errors that rsenf raises on purpose.

    Parameters
    ----------
    message : str
        What is wrong and where, in one line.
    hint : str
        What to do about it, in one line; may be empty.

    Examples
    --------
    >>> print(UsageError("a.mp4: no such file", "check the name"))
    a.mp4: no such file (check the name)
    """

    exit_code = EXIT_FAILED

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.message} ({self.hint})" if self.hint else self.message


class UsageError(RsenfError, ValueError):
    """The command or one of its arguments is invalid."""

    exit_code = EXIT_USAGE


class ConfigError(UsageError):
    """A configuration file with one or more problems, each with its file and line.

    Parameters
    ----------
    problems : list of str
        One line per problem, ``file:line: what was read, what is allowed``.
    """

    def __init__(self, problems: list[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = problems


class ReferenceFormatError(UsageError):
    """A file that can't be read as a grid-frequency reference."""


class InputError(RsenfError):
    """A recording that contains nothing usable."""


class NoSignal(InputError):
    """A readable recording without usable flicker of mains light."""


class SourceLost(RsenfError):
    """A live source that can't be reached, or was lost and did not return."""


class RecordingError(RsenfError):
    """A recording that can't be written."""


class NodeFailed(RsenfError):
    """A process of a running graph failed or could not be started."""


class SchemaMismatch(RsenfError):
    """Bytes that don't match their declared message class or version."""


def reason_of(exc: OSError) -> str:
    """Return the system's reason for an error, in lower case, to be part of a message.

    Examples
    --------
    >>> reason_of(OSError(28, "No space left on device"))
    'no space left on device'
    """
    return (exc.strerror or str(exc)).lower()


def did_you_mean(word: object, known: Iterable[str], after: str = "") -> str:
    """Return a question for the nearest known word, ``after`` a mark; empty if none is near.

    >>> did_you_mean("freq", ["freqs", "time"], after=": ")
    ": did you mean 'freqs'?"
    """
    near = difflib.get_close_matches(str(word), list(known), n=1)
    return f"{after}did you mean {near[0]!r}?" if near else ""

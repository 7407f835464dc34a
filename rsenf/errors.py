"""One small tree of errors; each knows the exit code and carries a hint.

::

    RsenfError                 1
    ├── UsageError             2   the command or its arguments can't be meant so
    │   ├── ConfigError        2   a graph or model file; lists every problem with file:line
    │   ├── ParameterError     2   a parameter of the capture model (rsenf.model.parameters)
    │   └── ReferenceFormatError 2 a grid reference that can't be read as one
    ├── InputError             1   a recording that yields nothing usable
    │   └── NoSignal           1   what there is of it can be read, and has no flicker
    ├── SourceLost             1   a live source that can't be reached
    ├── RecordingError         1   a recording can't be written (disk full, no rights)
    ├── NodeFailed             1   a process of a graph died
    └── SchemaMismatch         1   bytes that aren't the message they are said to be

Exit code 3, "done with loss", is not an error: the work was done and the result says what was
lost. Exit code 130 is an interruption by the user.
"""

from __future__ import annotations

EXIT_DONE = 0
EXIT_FAILED = 1
EXIT_USAGE = 2
EXIT_LOSS = 3
EXIT_INTERRUPTED = 130


class RsenfError(Exception):
    """Anything rsenf says no to.

    Parameters
    ----------
    message : str
        What is wrong and where, in one line.
    hint : str
        What to do about it, in one line; may be empty.
    """

    exit_code = EXIT_FAILED

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.message} ({self.hint})" if self.hint else self.message


class UsageError(RsenfError, ValueError):
    """The command or one of its arguments can't be meant so."""

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
    """A recording that yields nothing usable."""


class NoSignal(InputError):
    """A recording that can be read, but has no usable flicker of mains light in it."""


class SourceLost(RsenfError):
    """A live source that can't be reached, or stopped and did not come back."""


class RecordingError(RsenfError):
    """A recording that can't be written."""


class NodeFailed(RsenfError):
    """A process of a running graph died or could not be started."""


class SchemaMismatch(RsenfError):
    """Bytes that are not the message, or not the version, they are said to be."""

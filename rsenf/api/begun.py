"""What a long run has done so far, kept beside its result, so that the same run goes on from it.

A part that takes long is a function of what the run is given; its answer is kept under a hash of
all that it depends on, and used again only for the very same, of the same versions. What can't be
read is made anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import shutil
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rsenf import __version__
from rsenf.errors import InputError, RecordingError
from rsenf.whole_file import read_arrays, whole_file

FORMAT = 1  # another when the answers to the same question change
Arrays = dict[str, NDArray[np.generic]]


class Begun:
    """Answers kept of one run.

    Parameters
    ----------
    folder : Path or None
        Where, made when there is something to keep; nothing is kept without.
    of : str
        What all answers depend on: the input, and how it is treated.
    """

    def __init__(self, folder: Path | None, of: str) -> None:
        self.folder, self.of = folder, of
        self.found = False  # something that an earlier run has kept

    def kept(self, what: bytes, make: Callable[[], Arrays]) -> Arrays:
        """Return an earlier answer, or make and keep one.

        Parameters
        ----------
        what : bytes
            Which answer: all else that it depends on.
        make : callable
        """
        if self.folder is None:
            return make()
        of = f"{FORMAT} {__version__} {version('av')} {self.of} ".encode()
        path = self.folder / f"{hashlib.sha256(of + what).hexdigest()[:24]}.npz"
        try:
            arrays = read_arrays(path)
            self.found = True
        except ValueError:
            arrays = make()
            with contextlib.suppress(OSError, RecordingError):  # no room: then it isn't kept
                self.folder.mkdir(parents=True, exist_ok=True)
                with whole_file(path) as part:
                    np.savez(part, allow_pickle=False, **arrays)
        return arrays


@contextlib.contextmanager
def begun(out: Path | None, of: str) -> Iterator[Begun]:
    """Keep answers beside what a run is to write, until it has, or the input is of no use.

    Parameters
    ----------
    out : Path or None
        File or folder that the run is to write; nothing is kept without.
    of : str
        What all answers depend on; nothing is kept when empty.
    """
    folder = out.parent / f".{out.name}.begun" if out and of else None
    try:
        yield Begun(folder, of)
    except InputError:
        _forget(folder)
        raise
    _forget(folder)


def _forget(folder: Path | None) -> None:
    if folder:
        shutil.rmtree(folder, ignore_errors=True)

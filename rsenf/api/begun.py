"""Checkpoints of a long run, kept beside its result, from which the same run resumes.

A part that takes long is a function of the run's inputs; its answer is cached under a hash of all
that it depends on, and reused only for the very same inputs and versions. An unreadable one is
computed again.
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

FORMAT = 1  # changes when the answer to the same key does
Arrays = dict[str, NDArray[np.generic]]


class Begun:
    """Cached answers of one run.

    Parameters
    ----------
    folder : Path or None
        Created when there is something to keep; without, nothing is kept.
    of : str
        What all answers depend on: the input, and how it is treated.
    """

    def __init__(self, folder: Path | None, of: str) -> None:
        self.folder, self.of = folder, of
        self.found = False  # whether an answer of an earlier run was used

    def kept(self, what: bytes, make: Callable[[], Arrays]) -> Arrays:
        """Return a cached answer, or compute and cache one.

        Parameters
        ----------
        what : bytes
            Key of the answer: all else that it depends on.
        make : callable
            Computes the arrays.
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
            with contextlib.suppress(OSError, RecordingError):  # no room: not kept
                self.folder.mkdir(parents=True, exist_ok=True)
                with whole_file(path) as part:
                    np.savez(part, allow_pickle=False, **arrays)
        return arrays


@contextlib.contextmanager
def begun(out: Path | None, of: str) -> Iterator[Begun]:
    """Keep checkpoints beside a run's output until it is written, or the input proves unusable.

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

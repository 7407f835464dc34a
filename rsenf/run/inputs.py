"""Recordings as inputs of the one-process commands: video, MCAP, or arrays of luminance."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsenf.errors import InputError, UsageError
from rsenf.messages import Frame, Header, Mark, RowBlock

if TYPE_CHECKING:
    from rsenf.record import Recording

MCAP_MAGIC = b"\x89MCAP"
ROWS = "/rows"  # how topics of row blocks end


class Input(ABC):
    """A recording, opened.

    Attributes
    ----------
    name : str
        What to call it.
    duration_s : float or None
        How long it is, as far as it says so itself.
    begins_with : str
        'frames' or 'rows': which stage its messages are for.
    """

    name: str
    duration_s: float | None = None
    begins_with: str = "rows"

    @abstractmethod
    def messages(self) -> Iterator[Any]:
        """Yield frames or row blocks, without an END mark."""

    @property
    def loss(self) -> str:
        """What could not be read, in one line; empty when all was."""
        return ""

    @property
    def warnings(self) -> list[str]:
        """What a result should say about its input, one line each."""
        return []


def open_input_file(path: str | Path, *, camera: str = "", source: str = "") -> Input:
    """Open a recording by what it is, not by what it is called.

    Parameters
    ----------
    path : path
        Video, ``.mcap`` (a recording, or pictures of another program) or ``.npz``.
    camera : str, optional
        Which camera of an MCAP recording with several.
    source : str, optional
        What its messages say they come from; ``file/<name>`` unless given.

    Raises
    ------
    UsageError
        When there is no such file.
    InputError
        When it holds nothing that can be analysed.
    """
    if "://" in str(path) or Path(path).is_char_device():
        from rsenf.config import redact

        raise UsageError(f"{redact(str(path))} is a live source", "name it in a graph for 'run'")
    path = Path(path)
    if not path.is_file():
        if path.is_dir():
            raise UsageError(f"{path} is a folder", "name a file in it")
        raise UsageError(f"{path}: no such file", "look for a misspelling")
    kind = path.suffix.lower()
    if kind == ".mcap" or _start_of(path).startswith(MCAP_MAGIC):
        return _recorded(path, camera, source or f"file/{path.stem}")
    if kind == ".npz":
        from rsenf.run.npz import Luminance

        return Luminance(path, source or f"file/{path.stem}")
    return Video(path, source or f"file/{path.stem}")


def _recorded(path: Path, camera: str, source: str) -> Input:
    """Open an MCAP file: rows where it has them, else the pictures of another program."""
    from rsenf.record.reader import open_recording
    from rsenf.run.foreign.cameras import picture_topics
    from rsenf.run.foreign.video import ForeignVideo

    try:
        recording = open_recording(path)
    except InputError as exc:
        raise InputError(exc.message, exc.hint or "give the video itself") from exc
    has_rows = any(topic.endswith(ROWS) for topic in recording.topics)
    if not has_rows and picture_topics(recording):
        return ForeignVideo(recording, camera, source)
    return RecordedRows(recording, camera)


def _start_of(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(len(MCAP_MAGIC))
    except OSError as exc:
        raise UsageError(f"{path} can't be read: {exc.strerror}", "check its rights") from exc


class Video(Input):
    """A video file, decoded."""

    begins_with = "frames"

    def __init__(self, path: Path, source: str) -> None:
        from rsenf.decode.source import open_source
        from rsenf.decode.spec import SourceSpec

        self.name = path.name
        self._source = open_source(
            SourceSpec(url=str(path), kind="file"),
            source=source,
            run_id="",
            clock_ns=time.time_ns,
        )
        self.duration_s = self._source.info.duration_s

    def messages(self) -> Iterator[Any]:
        """Yield its frames."""
        with self._source as source:
            for item in source:
                if isinstance(item, Frame):
                    yield item

    @property
    def loss(self) -> str:
        """What could not be decoded."""
        return self._source.loss

    @property
    def warnings(self) -> list[str]:
        """What the container left open."""
        return self._source.warnings


class RecordedRows(Input):
    """Row blocks of one camera of an MCAP recording."""

    def __init__(self, recording: Recording, camera: str) -> None:
        path = recording.path
        self.name, self._path, self._recording = path.name, path, recording
        topics = {t.split("/")[-2]: t for t in recording.topics if t.endswith(ROWS)}
        if not topics:
            cut = "" if recording.complete else "is cut short and "
            raise InputError(
                f"{path} {cut}holds no row blocks", "record 'rows', or give the video itself"
            )
        names = ", ".join(topics)
        if not camera and len(topics) > 1:
            raise UsageError(f"{path} has several cameras: {names}", "choose one with --camera")
        if camera and camera not in topics:
            raise UsageError(f"{path} has no row blocks of camera {camera!r}", f"only of: {names}")
        self._topic = topics[camera or names]
        self._missing = 0

    def messages(self) -> Iterator[RowBlock]:
        """Yield its row blocks, as many as can be read."""
        epoch, due = 0, 0
        for _, message, _ in self._recording.messages([self._topic], tolerant=True):
            header: Header = message.header
            if header.epoch != epoch:
                epoch, due = header.epoch, 0
            self._missing += max(header.seq - due, 0)
            due = header.seq + 1
            if header.mark == Mark.DATA:
                yield message
        if not due and self._recording.loss:
            raise InputError(f"{self._path}: none of its row blocks can be read", self.loss)

    @property
    def loss(self) -> str:
        """What the file lacks."""
        return self._recording.lost

    @property
    def warnings(self) -> list[str]:
        """Row blocks that never reached the recording."""
        return [f"row blocks that were not recorded: {self._missing}"] if self._missing else []

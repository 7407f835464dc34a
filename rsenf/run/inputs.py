"""Inputs of the one-process commands: a video, an MCAP recording, or luminance.

Luminance sampled by another program comes as arrays, or as an ``.npz`` file of them.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsenf.decode.source import EffortChoice, SourceSpec, VideoSource, open_source
from rsenf.errors import InputError, UsageError
from rsenf.messages import Frame, Header, RateBasis, RowBlock
from rsenf.messages.plausible import MOST_LEVEL, MOST_NS
from rsenf.registry import Registry
from rsenf.rows.stage import blocks_from_luminance
from rsenf.whole_file import read_arrays

ARRAYS = "arrays"  # name of an input without a file
LONGEST_MAGIC = 16


class Input(ABC):
    """An open recording.

    Attributes
    ----------
    name : str
        Name for messages.
    path : Path or None
        Its file, if any.
    tells_arrival : bool
        Whether its messages carry arrival times.
    duration_s : float or None
        Its declared duration; None if unknown.
    begins_with : str
        Topic of its messages: 'frames', 'rows' or 'track'.
    """

    name: str
    path: Path | None = None
    tells_arrival: bool = False
    duration_s: float | None = None
    begins_with: str = "rows"

    @abstractmethod
    def messages(self) -> Iterator[Any]:
        """Yield frames, row blocks or estimates, without an END mark."""

    @property
    def called(self) -> str:
        """Its path, or else its name: distinct among several recordings."""
        return str(self.path or self.name)

    @property
    def loss(self) -> str:
        """What could not be read, in one line; empty if nothing was lost."""
        return ""

    @property
    def warnings(self) -> list[str]:
        """Warnings about the input that belong in a result, one line each."""
        return []


def open_input_file(
    path: str | Path,
    *,
    camera: str = "",
    source: str = "",
    begin: str = "rows",
    threads: int = 0,
    frame_rate_hz: float | None = None,
    effort: EffortChoice = "auto",
) -> Input:
    """Open a recording. The format is recognised by suffix or first bytes.

    Parameters
    ----------
    path : path
        Video, ``.mcap`` (a recording of rsenf, or pictures of another program) or ``.npz``.
    camera : str, optional
        Camera of an MCAP recording with several.
    source : str, optional
        ``source`` of the message headers; ``file/<name>`` by default.
    begin : str
        Topic to read from an MCAP recording: 'rows', 'track' for its estimates, or 'frames', which
        decodes its video again.
    threads : int, optional
        Decoder threads of a video file; by default enough for all cores.
    frame_rate_hz : float, optional
        Constant frame rate: replaces the time stamps of a video, and serves arrays without times.
    effort : {'full', 'fast', 'auto'}
        How a video file is decoded, see :class:`rsenf.decode.SourceSpec`.

    Raises
    ------
    UsageError
        When the file doesn't exist, has no such topic, or has frame times that a rate can't
        replace.
    InputError
        When it holds nothing that can be analysed.
    """
    if "://" in str(path) or Path(path).is_char_device():
        from rsenf.config import redact

        raise UsageError(
            f"{redact(str(path))} is a live source", "see 'rsenf track', 'live', 'probe', 'init'"
        )
    path = Path(path)
    if not path.is_file():
        if path.is_dir():
            raise UsageError(f"{path} is a folder", "name a file in it")
        raise UsageError(f"{path}: no such file", "look for a misspelling")
    start, wanted = (
        _start_of(path),
        Opening(camera, source or f"file/{path.stem}", begin, threads, frame_rate_hz, effort),
    )
    found = next((f for f in FORMATS.usable().values() if f.is_of(path, start)), FORMATS["video"])
    if begin not in found.begins:
        raise UsageError(f"{path} is no recording of {begin}", "give an .mcap recording")
    if frame_rate_hz is not None and not found.may_lack_times:
        raise timed(path)
    if effort == "fast" and found is not FORMATS["video"]:
        raise UsageError(f"{path} is no video file", "give no effort of decoding")
    return found.open(path, wanted)


def timed(path: Path) -> UsageError:
    """Return the error for a frame rate given with a recording that has frame times."""
    return UsageError(f"{path} has frame times of its own", "give no frame rate")


class Opening(NamedTuple):
    """Options of opening a recording: the arguments of :func:`open_input_file`."""

    camera: str
    source: str
    begin: str
    threads: int
    frame_rate_hz: float | None
    effort: EffortChoice


@dataclass(frozen=True)
class Format:
    """A file format of recordings.

    Attributes
    ----------
    open : callable
        Takes a path and an :class:`Opening`, returns an :class:`Input`.
    begins : tuple of str
        Topics that can be read from it.
    suffix : str
        Suffix of its files; empty for any.
    magic : bytes
        First bytes of its files; empty for any.
    may_lack_times : bool
        Whether frames may lack time stamps, so that a frame rate may be given.
    """

    open: Callable[[Path, Opening], Input]
    begins: tuple[str, ...]
    suffix: str = ""
    magic: bytes = b""
    may_lack_times: bool = False

    def is_of(self, path: Path, start: bytes) -> bool:
        """Whether a file is of this format, by its name and its first bytes."""
        named = bool(self.suffix) and path.suffix.lower() == self.suffix
        return named or (bool(self.magic) and start.startswith(self.magic))


def _recorded(path: Path, opening: Opening) -> Input:
    """Open an MCAP file: a recording of rsenf, or pictures of another program."""
    from rsenf.record.reader import open_recording
    from rsenf.run.foreign.finder import ForeignVideo, picture_topics
    from rsenf.run.replay.player import Replayed

    try:
        recording = open_recording(path)
    except InputError as exc:
        raise InputError(exc.message, exc.hint or "give the video itself") from exc
    ours = any(topic.is_ours for topic in recording.topics.values())
    if not ours and opening.begin != "track" and picture_topics(recording):
        return ForeignVideo(recording, opening.camera, opening.source)
    return Replayed(recording, opening.camera, opening.begin)


def _start_of(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(LONGEST_MAGIC)
    except OSError as exc:
        raise UsageError(f"{path} can't be read: {exc.strerror}", "check its rights") from exc


_NAMES = ("rows", "frame_time_s", "luminance", "frame_rate_hz")
_NEEDED = (
    "needed: 'rows' (frames × rows, or frames × rows × strips) or 'luminance' (frames), "
    "with 'frame_rate_hz', or rows with 'frame_time_s' (frames)"
)


class Luminance(Input):
    """Arrays of luminance as an input.

    Parameters
    ----------
    held : mapping of str to array_like
        Either ``rows`` (frames × rows, or frames × rows × strips) with ``frame_time_s`` (frames,)
        or ``frame_rate_hz``, or ``luminance`` (frames,) with ``frame_rate_hz``.
    header : Header
        Template of the message headers: their source, and where frame times come from.
    path : Path, optional
        File that held the arrays.

    Raises
    ------
    InputError
        When the arrays' names, shapes or values are wrong.
    """

    def __init__(
        self, held: Mapping[str, ArrayLike], header: Header, path: Path | None = None
    ) -> None:
        self.name, self.path, self._header = path.name if path else ARRAYS, path, header
        arrays = {name: np.asarray(array) for name, array in held.items()}
        self._level, self._time_s, self._axis = _luminance(str(path or ARRAYS), arrays)
        self.duration_s = float(self._time_s[-1] - self._time_s[0])

    def messages(self) -> Iterator[RowBlock]:
        """Cut the arrays into row blocks."""
        return blocks_from_luminance(
            self._level, self._time_s, self._header, read_out_axis=self._axis
        )


def read_npz(path: Path, source: str, frame_rate_hz: float | None = None) -> Luminance:
    """Read luminance from an ``.npz`` file.

    Parameters
    ----------
    path : Path
    source : str
        ``source`` of the message headers.
    frame_rate_hz : float, optional
        Constant frame rate, for arrays without ``frame_time_s``.

    Raises
    ------
    InputError
        When the file can't be read, or the arrays' names, shapes or values are wrong.
    UsageError
        When a frame rate is given though the file has frame times.
    """
    try:
        held = read_arrays(path, _NAMES)
    except ValueError as exc:
        raise InputError(f"{path} {exc}", "write it again") from exc
    basis = RateBasis.STAMPED if {"rows", "frame_time_s"} <= held.keys() else RateBasis.DECLARED
    if frame_rate_hz is not None:
        if basis is RateBasis.STAMPED:
            raise timed(path)
        held["frame_rate_hz"], basis = np.array(frame_rate_hz), RateBasis.GIVEN
    return Luminance(held, Header(source=source, rate_basis=basis), path)


def _luminance(
    where: str, held: dict[str, NDArray[Any]]
) -> tuple[NDArray[Any], NDArray[np.float64], str]:
    """Check the arrays; return level (frames, rows, strips), frame times (s), read-out axis."""
    for name, array in held.items():
        if array.dtype.kind not in "fiu":
            raise InputError(f"{where}: '{name}' holds {array.dtype}, not numbers", _NEEDED)
    if "rows" in held and held.keys() & {"frame_time_s", "frame_rate_hz"}:
        level, axis, least, most = held["rows"], "rows", 2, 3
        if "frame_time_s" in held:
            time_s = held["frame_time_s"].astype(np.float64)
        else:
            time_s = np.arange(len(np.atleast_1d(level))) / _rate_hz(where, held["frame_rate_hz"])
    elif {"luminance", "frame_rate_hz"} <= held.keys():
        level, axis, least, most = held["luminance"], "frame", 1, 1
        time_s = np.arange(level.size) / _rate_hz(where, held["frame_rate_hz"])
    else:
        raise InputError(f"{where} holds {', '.join(held) or 'nothing of use'}", _NEEDED)
    if not (least <= level.ndim <= most and level.size and time_s.shape == level.shape[:1]):
        raise InputError(f"{where}: shapes {level.shape} and {time_s.shape} don't fit", _NEEDED)
    if not (np.isfinite(level).all() and np.isfinite(time_s).all()):
        raise InputError(f"{where} holds values that are not finite", "leave such frames out")
    for what, array, limit in (("levels", level, MOST_LEVEL), ("times", time_s, MOST_NS / 1e9)):
        if (largest := max(float(array.max()), -float(array.min()))) > limit:
            raise InputError(
                f"{where} holds {what} of {largest:.3g}, at most {limit:.3g} are read",
                "levels are of 8 bits, times in seconds",
            )
    if not (np.diff(time_s) > 0).all():
        raise InputError(f"{where}: frame_time_s does not rise throughout", "sort its frames")
    return level.reshape(level.shape + (1,) * (3 - level.ndim)), time_s, axis


def _rate_hz(where: str, rate_hz: NDArray[Any]) -> float:
    if rate_hz.size != 1 or not 0 < rate_hz.item() < np.inf:
        raise InputError(f"{where}: frame_rate_hz is {rate_hz}", "one number above 0 is needed")
    return float(rate_hz.item())


class Decoded(Input):
    """A source whose pictures are decoded."""

    begins_with = "frames"
    _source: VideoSource

    def messages(self) -> Iterator[Any]:
        """Yield its frames."""
        with self._source as source:
            for item in source:
                if isinstance(item, Frame):
                    yield item

    @property
    def loss(self) -> str:
        """What was lost until now, or could not be decoded."""
        return self._source.loss

    @property
    def warnings(self) -> list[str]:
        """Warnings about the times of the container or the stream."""
        return self._source.warnings


class Video(Decoded):
    """A video file, decoded."""

    def __init__(self, path: Path, opening: Opening) -> None:
        self.name, self.path = path.name, path
        spec = SourceSpec(
            url=str(path),
            kind="file",
            threads=opening.threads,
            frame_rate_hz=opening.frame_rate_hz,
            effort=opening.effort,
        )
        self._source = open_source(spec, source=opening.source, run_id="", clock_ns=time.time_ns)
        self.duration_s = self._source.info.duration_s


# The first format that a file matches opens it; FFmpeg gets what matches none.
FORMATS: Registry[Format] = Registry(
    "input format",
    "rsenf.inputs",
    {
        "mcap": Format(_recorded, ("frames", "rows", "track"), ".mcap", b"\x89MCAP"),
        "npz": Format(
            lambda path, o: read_npz(path, o.source, o.frame_rate_hz),
            ("rows",),
            ".npz",
            may_lack_times=True,
        ),
        "video": Format(Video, ("frames", "rows"), may_lack_times=True),
    },
)

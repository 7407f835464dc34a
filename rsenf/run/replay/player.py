"""Plays a recording: a part of it, at any speed, once or in a loop.

Replayed messages get new headers: another run id, and a new epoch after every jump. A recording can
also be the input of a one-process command.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsenf.bus.keys import REFERENCE, TOPICS, topic_of
from rsenf.errors import InputError, UsageError
from rsenf.messages import Header, Mark
from rsenf.record.reader import Recording, open_recording
from rsenf.run.inputs import Input
from rsenf.run.replay.control import Control, Pace
from rsenf.run.replay.tape import FRAMES, VIDEO, Tape, as_named, chosen
from rsenf.timebase import NS_PER_S, nanoseconds


class Stamps:
    """Assigns headers to replayed messages.

    Stages are renewed when run or epoch of their input change. So recorded epochs are kept until
    a jump (seek, loop); after it, epochs on all topics continue above the highest one used. A
    second run within a recording counts as a jump, since a player is one run.

    Parameters
    ----------
    run_id : str
        Run id of the player.
    clock_ns : callable
        Wall clock, for the arrival times.
    keys : iterable of str
        All keys that are played.
    """

    def __init__(self, run_id: str, clock_ns: Callable[[], int], keys: Iterable[str]) -> None:
        self._run_id, self._clock_ns = run_id, clock_ns
        self._highest = -1
        self._offsets: dict[str, int] = {}  # of epochs, by recorded run
        self._joined: dict[str, tuple[str, int, int]] = {}  # where each key began since the jump
        self._last: dict[str, Header | None] = dict.fromkeys(keys)

    def jump(self) -> None:
        """Begin new epochs: what follows doesn't continue what came before."""
        self._offsets.clear()
        self._joined.clear()

    def stamp(self, key: str, message: Any) -> Any:
        """Return a message with its new header.

        A stream joined in the middle is numbered from 0; later gaps are preserved.
        """
        old: Header = message.header
        place = (old.run_id, old.epoch, old.seq)
        first = self._joined.setdefault(key, place)
        seq = old.seq - first[2] if first[:2] == place[:2] else old.seq
        header = dataclasses.replace(
            old,
            run_id=self._run_id,
            epoch=old.epoch if topic_of(key) == REFERENCE else self._epoch(old),
            seq=seq,
            arrival_time_ns=self._clock_ns(),
        )
        stamped = as_named(dataclasses.replace(message, header=header), key)
        self._last[key] = stamped.header
        return stamped

    def _epoch(self, header: Header) -> int:
        offset = self._offsets.setdefault(header.run_id, self._highest + 1)
        self._highest = max(self._highest, offset + header.epoch)
        return offset + header.epoch

    def ends(self) -> Iterator[tuple[str, Any]]:
        """Yield every key's END mark."""
        for key, last in self._last.items():
            cls, seq = TOPICS[topic_of(key)], last.seq + 1 if last else 0
            header = (last or Header(run_id=self._run_id)).numbered(seq, Mark.END)
            yield key, as_named(cls(header=header), key)


@dataclass(frozen=True)
class Playing:
    """What to play, and how.

    Parameters
    ----------
    topics, rename, site
        As for :func:`rsenf.run.replay.tape.chosen`.
    rate : float
        Recorded seconds per second; 0 for as fast as the receiver takes messages.
    start_s, end_s : float
        Part to play, in seconds from the first message of the recording's streams.
    loop : int
        Number of passes; 0 for until stopped.
    """

    topics: tuple[str, ...] = ()
    rename: Mapping[str, str] = field(default_factory=dict)
    site: str = ""
    rate: float = 0.0
    start_s: float = 0.0
    end_s: float | None = None
    loop: int = 1


class Player:
    """Iterable of keys and messages, each yielded when due; END marks last, even when stopped.

    The rate determines when a message is yielded, never which ones or in which order. The consumer
    exerts backpressure by not asking for the next one.

    Parameters
    ----------
    path : path
        The recording.
    playing : Playing
        What to play, and how.
    run_id : str
        For the headers.
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    control : Control, optional
        To pause, step, seek and stop.

    Attributes
    ----------
    keys : tuple of str
        Keys that are played.
    position_s : float
        Present position.
    passes : int
        Number of completed passes.

    Raises
    ------
    UsageError
        When there is no such file, topic or part.
    InputError
        When it isn't a recording.
    """

    def __init__(
        self,
        path: str | Path,
        playing: Playing,
        *,
        run_id: str,
        clock_ns: Callable[[], int],
        control: Control | None = None,
    ) -> None:
        recording = open_recording(path)
        names = chosen(recording, playing.topics, playing.rename, playing.site)
        self._tape = Tape(recording, names)
        self.keys = tuple(names.values())
        self.position_s, self.passes, self._played = playing.start_s, 0, 0
        self._control = control or Control()
        self._pace = Pace(playing.rate)
        self._stamps = Stamps(run_id, clock_ns, self.keys)
        self._loop = playing.loop
        self._start_ns, self._end_ns = self._part(playing)

    def _part(self, playing: Playing) -> tuple[int, int]:
        tape = self._tape
        start_ns, end_ns = tape.first_ns + nanoseconds(playing.start_s), tape.last_ns + 1
        if start_ns >= end_ns:
            raise UsageError(
                f"{tape.path} ends before {playing.start_s:g} s",
                f"it is {(tape.last_ns - tape.first_ns) / NS_PER_S:.1f} s long",
            )
        if playing.end_s is not None:
            if playing.end_s <= playing.start_s:
                raise UsageError(
                    f"nothing lies between {playing.start_s:g} s and {playing.end_s:g} s",
                    "the end must come after the start",
                )
            end_ns = min(end_ns, tape.first_ns + nanoseconds(playing.end_s))
        return start_ns, end_ns

    @property
    def loss(self) -> str:
        """What could not be read, in one line; empty if nothing was lost."""
        loss = self._tape.loss
        return f"{loss}; played up to {self.position_s:.1f} s" if loss else ""

    def __iter__(self) -> Iterator[tuple[str, Any]]:
        at_ns = self._start_ns
        yield from self._references()
        while not self._control.stop.is_set():
            self._stamps.jump()
            self._pace.restart()
            played = self._played
            whole = yield from self._pass(at_ns)
            nothing = self._played == played and at_ns == self._start_ns
            at_ns = self._start_ns
            if not whole:
                at_ns = self._sought_ns()
                continue
            self.passes += 1
            if self.passes == self._loop or nothing:  # an empty part would loop without pause
                break
        yield from self._stamps.ends()

    def _references(self) -> Iterator[tuple[str, Any]]:
        """Play references once, neither paced nor stepped: they have no stream time."""
        for key, message in self._tape.references():
            if self._control.stop.is_set():
                return
            yield key, self._stamps.stamp(key, message)

    def _pass(self, at_ns: int) -> Generator[tuple[str, Any], None, bool]:
        """Play to the end; return whether it was reached."""
        self._be_at(at_ns)
        for time_ns, key, message in self._tape.play(at_ns, self._end_ns):
            # Packets before the start, which decoding needs, are due at the start.
            due_ns = max(time_ns, at_ns)
            if not self._admitted(due_ns):
                return False
            self._be_at(due_ns)
            self._played += 1
            yield key, self._stamps.stamp(key, message)
        return True

    def _be_at(self, time_ns: int) -> None:
        self.position_s = (time_ns - self._tape.first_ns) / NS_PER_S

    def _admitted(self, time_ns: int) -> bool:
        paused = self._control.paused
        admitted = self._control.admit(lambda: self._pace.left_s(time_ns))
        if paused or self._control.paused:
            self._pace.restart()
        return admitted

    def _sought_ns(self) -> int:
        by_s = self._control.sought_s() or 0.0
        place_ns = self._tape.first_ns + nanoseconds(self.position_s + by_s)
        return min(max(place_ns, self._start_ns), self._end_ns)


WORDS = {"frames": "video", "rows": "row blocks", "track": "estimates"}


class Replayed(Input):
    """One topic of one camera of a recording.

    Parameters
    ----------
    recording : Recording
    camera : str
        Name of the camera; may be empty if there is only one.
    begin : str
        Topic to read: 'frames', 'rows' or 'track'.
    rate : float
        Recorded seconds per second; 0 for full speed.

    Raises
    ------
    UsageError
        When there is no such camera, or several and none is named.
    InputError
        When the recording has no such topic.
    """

    tells_arrival = True

    def __init__(
        self, recording: Recording, camera: str = "", begin: str = "rows", *, rate: float = 0.0
    ) -> None:
        path = recording.path
        self.name, self.path, self.begins_with = path.name, path, begin
        self._missing, self._taken = 0, 0
        self._loss = recording.lost
        topic = f"{_camera(recording, camera, begin)}/{begin}"
        self._player = Player(
            path, Playing(topics=(topic,), rate=rate), run_id="", clock_ns=time.time_ns
        )

    def messages(self) -> Iterator[Any]:
        """Yield all messages that can be read."""
        epoch, due = 0, 0
        for _, message in self._player:
            header: Header = message.header
            if header.is_end:
                break
            if header.epoch != epoch:
                epoch, due = header.epoch, 0
            self._missing += max(header.seq - due, 0)
            due = header.seq + 1
            self._taken += 1
            yield message
        self._loss = self._player.loss
        if not self._taken and self._loss:
            what = WORDS[self.begins_with]
            raise InputError(f"{self.path}: none of its {what} can be read", self._loss)

    @property
    def loss(self) -> str:
        """What could not be read of the file, in one line."""
        return self._loss

    @property
    def warnings(self) -> list[str]:
        """The number of messages missing in the recording, by sequence number."""
        what = WORDS[self.begins_with]
        return [f"{what} that were not recorded: {self._missing}"] if self._missing else []


def _camera(recording: Recording, camera: str, begin: str) -> str:
    """Return the camera to read: the one named, or the only one."""
    path, what = recording.path, WORDS[begin]
    topic = VIDEO if begin == FRAMES else begin
    cameras = [key.split("/")[-2] for key in recording.topics if topic_of(key) == topic]
    if not cameras:
        cut = "" if recording.complete else "is cut short and "
        raise InputError(
            f"{path} {cut}holds no {what}", f"record {topic!r}, or give the video itself"
        )
    names = ", ".join(cameras)
    if not camera and len(cameras) > 1:
        raise UsageError(f"{path} has several cameras: {names}", "choose one with --camera")
    if camera and camera not in cameras:
        raise UsageError(f"{path} has no {what} of camera {camera!r}", f"only of: {names}")
    return camera or names

"""A recording with every topic of one camera, made in one process, and what is replayed of it."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from conftest import Film

from rsenf.decode.source import SourceSpec, open_source
from rsenf.idle import IdleSettings
from rsenf.match import Match
from rsenf.messages import Frame, Header, Mark, digest
from rsenf.record.writer import Recorder
from rsenf.reference import read_reference, reference_blocks
from rsenf.rows.settings import RowsSettings
from rsenf.run.inline import analyse
from rsenf.run.inputs import Input
from rsenf.run.replay.control import Control
from rsenf.run.replay.player import Player, Playing
from rsenf.track import TrackSettings

TRACK = TrackSettings(method="projection", nominal_hz=50.0)
RESULTS = ("track", "match")
Streams = dict[str, list[Any]]


class _Filmed(Input):
    """The frames of a film; its packets go to the recorder."""

    name, begins_with = "film", "frames"

    def __init__(self, film: Film, recorder: Recorder) -> None:
        self._film, self._recorder = film, recorder

    def messages(self) -> Iterable[Any]:
        spec = SourceSpec(url=str(self._film.video), kind="file", with_packets=True)
        with open_source(spec, source="lab/cam", run_id="r", clock_ns=time.time_ns) as source:
            for item in source:
                topic = "frames" if isinstance(item, Frame) else "video"
                self._recorder.write(f"rsenf/lab/cam/{topic}", item)
                if topic == "frames":
                    yield item


def blocks(film: Film) -> list[Any]:
    reference = read_reference(str(film.reference), grid="ce")
    return list(reference_blocks(reference, source="reference/ce", run_id="r"))


def record(film: Film, path: Path) -> Path:
    """Record a film with all that comes of it."""
    with Recorder(path, run_info={"run_id": "r"}, clock_ns=time.time_ns) as recorder:
        for block in blocks(film):
            recorder.write("rsenf/lab/reference/ce", block)
        last: dict[str, Any] = {}

        def tap(topic: str, message: Any) -> None:
            recorder.write(f"rsenf/lab/cam/{topic}", message)
            last[topic] = message
            if topic == "rows":
                recorder.flush()  # whatever the time it took: parts of the file are to be lost

        in_one_process(_Filmed(film, recorder), film, tap=tap)
        for topic, message in last.items():
            end = message.header.numbered(message.header.seq + 1, Mark.END)
            recorder.write(f"rsenf/lab/cam/{topic}", type(message)(header=end))
    return path


def in_one_process(recording: Input, film: Film, **more: Any) -> dict[str, str]:
    """Run the stages; returns a hash of each topic that comes out of them."""
    out: Streams = defaultdict(list)
    given = more.get("tap", lambda topic, message: None)

    def tap(topic: str, message: Any) -> None:
        out[topic].append(message)
        given(topic, message)

    analyse(
        recording,
        rows=RowsSettings(),
        track=TRACK,
        idle=IdleSettings(nominal_hz=50.0),
        make_match=lambda: Match(grid="ce"),
        reference=blocks(film),
        tap=tap,
    )
    assert out["match"], "no verdict"
    return hashes(out)


def hashes(streams: Streams) -> dict[str, str]:
    """SHA-256 of the data of each topic: values, numbers, frames, stream times."""
    return {
        topic: digest(m for m in messages if not m.header.is_end)
        for topic, messages in streams.items()
    }


def player(path: Path, control: Control | None, **playing: Any) -> Player:
    """A player, as a node would make it."""
    return Player(path, Playing(**playing), run_id="new", clock_ns=lambda: 10**18, control=control)


def played(path: Path, **playing: Any) -> list[tuple[str, Any]]:
    """All that a player yields."""
    return list(player(path, None, **playing))


def data(items: Iterable[tuple[str, Any]]) -> Streams:
    """Messages by topic, without the marks."""
    out: Streams = defaultdict(list)
    for key, message in items:
        if not message.header.is_end:
            out[key.split("/", 2)[2]].append(message)
    return out


def places(messages: Iterable[Any]) -> list[tuple[int, int]]:
    """Epoch and number of each message."""
    heads: list[Header] = [m.header for m in messages]
    return [(h.epoch, h.seq) for h in heads]

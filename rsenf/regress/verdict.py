"""What came of a comparison: by topic, and of a recording as a whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from rsenf.messages import Header
from rsenf.regress.fields import Moved
from rsenf.timebase import NS_PER_S, utc_text


@dataclass(frozen=True)
class Since:
    """From where on a topic isn't as it was.

    Attributes
    ----------
    message : int
        Number of the first message that differs, in the order of the recording.
    frame : int
        First frame that it covers; -1 for none.
    time_s : float
        Stream time of that, from the topic's first message.
    utc : str or None
        Where it lies on the recording's time line.
    """

    message: int
    frame: int
    time_s: float
    utc: str | None


@dataclass
class MovedField:
    """A field that moved: in how many messages, by how much, and how much was allowed there."""

    messages: int = 0
    by: float = 0.0
    allowed: float = 0.0

    def take(self, moved: Moved) -> None:
        """Count one message's."""
        self.messages += 1
        if (moved.by or 0.0) >= self.by:
            self.by, self.allowed = moved.by or 0.0, moved.allowed


@dataclass
class TopicVerdict:
    """What came of one stage.

    Attributes
    ----------
    topic, stage : str
        Where it sends to, and its kind; ``decode`` where it is the video that lacks frames.
    messages : int
        Recorded messages that were compared.
    differing : int
        Of these, how many differ, with those that only one side has.
    missing, extra : int
        Messages that didn't come again, and that weren't recorded.
    fields : dict
        What moved.
    since : Since or None
        From where on.
    unjudged : str
        Why a part of it can't be judged; empty when all was.
    """

    topic: str
    stage: str
    messages: int = 0
    differing: int = 0
    missing: int = 0
    extra: int = 0
    fields: dict[str, MovedField] = field(default_factory=dict)
    since: Since | None = None
    unjudged: str = ""
    _first_ns: int | None = None

    @property
    def passed(self) -> bool:
        """Whether nothing moved."""
        return not self.differing

    @property
    def max_abs_diff(self) -> float:
        """Largest difference of two numbers of the same field, whatever its unit."""
        return max((f.by for f in self.fields.values()), default=0.0)

    def take(self, header: Header, moved: Sequence[Moved], log_time_ns: int) -> None:
        """Count a recorded message and what differs of it."""
        if self._first_ns is None:
            self._first_ns = header.pts_ns
        if moved:
            self._differs(header, log_time_ns)
        for one in moved:
            self.fields.setdefault(one.field, MovedField()).take(one)
        self.messages += 1

    def lack(self, header: Header, log_time_ns: int) -> None:
        """Count a recorded message that didn't come again."""
        self.missing += 1
        self._differs(header, log_time_ns)
        self.messages += 1

    def add(self, header: Header) -> None:
        """Count a message that came again without having been recorded."""
        self.extra += 1
        self._differs(header, 0)

    def _differs(self, header: Header, log_time_ns: int) -> None:
        self.differing += 1
        if self.since is None:
            start_ns = header.pts_ns if self._first_ns is None else self._first_ns
            self.since = Since(
                self.messages,
                header.frame_first,
                (header.pts_ns - start_ns) / NS_PER_S,
                utc_text(log_time_ns),
            )


@dataclass(frozen=True)
class Regression:
    """What came of one recording.

    Attributes
    ----------
    recording : str
        Its path.
    changed : dict
        What isn't as it was when it was made: then and now, by name. Empty: bits were compared.
    topics : list of TopicVerdict
        In the order of the data.
    left_out : dict
        Recorded topics whose stage could not be run again, and why.
    loss : str
        What of the recording can't be read; empty when all can.
    error : str
        Why nothing came of it; empty when something did.
    """

    recording: str
    changed: dict[str, tuple[str, str]]
    topics: list[TopicVerdict]
    left_out: dict[str, str]
    loss: str = ""
    error: str = ""

    @property
    def exact(self) -> bool:
        """Whether every bit counted."""
        return not self.changed and not self.error

    @property
    def passed(self) -> bool:
        """Whether it was compared, and nothing moved."""
        return not self.error and all(topic.passed for topic in self.topics)

    @property
    def first(self) -> TopicVerdict | None:
        """First topic that moved: its stage was fed with what was recorded, so it is to blame."""
        return next((topic for topic in self.topics if not topic.passed), None)

    @property
    def whole(self) -> bool:
        """Whether all of it could be judged."""
        return not self.loss and not self.error and not any(topic.unjudged for topic in self.topics)


def as_json(results: Sequence[Regression]) -> dict[str, Any]:
    """Return the results of one or more recordings as plain data."""
    return {
        "passed": all(result.passed for result in results),
        "topics": [_topic(r.recording, t) for r in results for t in r.topics],
        "recordings": [
            {
                "recording": r.recording,
                "passed": r.passed,
                "exact": r.exact,
                "first_stage": r.first.stage if r.first else None,
                "changed": {name: list(values) for name, values in r.changed.items()},
                "left_out": r.left_out,
                "loss": r.loss,
                "error": r.error,
            }
            for r in results
        ],
    }


def _topic(recording: str, topic: TopicVerdict) -> dict[str, Any]:
    since = topic.since
    return {
        "recording": recording,
        "topic": topic.topic,
        "stage": topic.stage,
        "messages": topic.messages,
        "differing": topic.differing,
        "max_abs_diff": topic.max_abs_diff,
        "missing": topic.missing,
        "extra": topic.extra,
        "since": None if since is None else {
            "message": since.message, "frame": since.frame,
            "time_s": since.time_s, "utc": since.utc,
        },
        "fields": [
            {"field": name, "messages": f.messages, "max_abs_diff": f.by, "allowed": f.allowed}
            for name, f in topic.fields.items()
        ],
        "unjudged": topic.unjudged,
    }  # fmt: skip

"""Results of a comparison: per topic, and of a recording as a whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from rsenf.messages import Header
from rsenf.regress.tolerance import Moved
from rsenf.timebase import NS_PER_S, utc_text


@dataclass(frozen=True)
class Since:
    """The first difference in a topic.

    Attributes
    ----------
    message : int
        Number of the first message that differs, in the order of the recording.
    frame : int
        First frame that it covers; -1 for none.
    time_s : float
        Its stream time, from the topic's first message.
    utc : str or None
        Its time in the recording.
    """

    message: int
    frame: int
    time_s: float
    utc: str | None


@dataclass
class MovedField:
    """A field that differs: number of messages, largest difference, and the tolerance there."""

    messages: int = 0
    by: float = 0.0
    allowed: float = 0.0

    def take(self, moved: Moved) -> None:
        """Count one message."""
        self.messages += 1
        if (moved.by or 0.0) >= self.by:
            self.by, self.allowed = moved.by or 0.0, moved.allowed


@dataclass
class TopicVerdict:
    """Result of one stage.

    Attributes
    ----------
    topic, stage : str
        Its topic and kind; the kind is ``decode`` if frames are missing in the video.
    messages : int
        Number of recorded messages that were compared.
    differing : int
        Number of messages that differ or that only one side has.
    missing, extra : int
        Number of messages that were not produced again, and that were not recorded.
    fields : dict
        Fields that differ.
    since : Since or None
        The first difference.
    unjudged : str
        Why a part could not be compared; empty if all was.
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
        """Whether nothing differs."""
        return not self.differing

    @property
    def max_abs_diff(self) -> float:
        """Largest difference of two numbers of the same field, in any unit."""
        return max((f.by for f in self.fields.values()), default=0.0)

    def take(self, header: Header, moved: Sequence[Moved], log_time_ns: int) -> None:
        """Count a recorded message and its differences."""
        if self._first_ns is None:
            self._first_ns = header.pts_ns
        if moved:
            self._differs(header, log_time_ns)
        for one in moved:
            self.fields.setdefault(one.field, MovedField()).take(one)
        self.messages += 1

    def lack(self, header: Header, log_time_ns: int) -> None:
        """Count a recorded message that was not produced again."""
        self.missing += 1
        self._differs(header, log_time_ns)
        self.messages += 1

    def add(self, header: Header) -> None:
        """Count a message that was produced but not recorded."""
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
    """Result of one recording.

    Attributes
    ----------
    recording : str
        Its path.
    changed : dict
        Versions that changed since it was made: then and now, by name. If empty, bits were
        compared.
    topics : list of TopicVerdict
        In the order of the data flow.
    left_out : dict
        Recorded topics whose stage could not be run again, and why.
    loss : str
        What part of the recording can't be read; empty for none.
    error : str
        Why there is no result; empty if there is one.
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
        """Whether it was compared, and nothing differs."""
        return not self.error and all(topic.passed for topic in self.topics)

    @property
    def first(self) -> TopicVerdict | None:
        """First topic that differs; its stage had the recorded input, so it is the cause."""
        return next((topic for topic in self.topics if not topic.passed), None)

    @property
    def whole(self) -> bool:
        """Whether all of it could be compared."""
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

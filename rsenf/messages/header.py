"""The header of every message: origin, place in the stream, clocks, frame range."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Any

from rsenf.messages.schema import field, message


class Mark(IntEnum):
    """Role of a message in its stream. BEGIN and END carry no data."""

    DATA = 0
    BEGIN = 1
    END = 2


class RateBasis(StrEnum):
    """Source of the frame rate if frame times only count frames; STAMPED for real time stamps."""

    STAMPED = ""
    DECLARED = "declared"
    ASSUMED = "assumed"
    GIVEN = "given"


@message(1, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class Header:
    """Origin, place in the stream, the three clocks, and the frames covered."""

    run_id: str = field(1, "identity of the run that made it; not part of the content", "")
    source: str = field(2, "<site>/<camera>, or reference/<grid>", "")
    epoch: int = field(3, "counts restarts of the source: loop, seek, reconnection", 0)
    seq: int = field(4, "counts the messages of this topic within the epoch, from 0", 0)
    mark: int = field(5, "0 data, 1 the stream begins, 2 the stream has ended", Mark.DATA)
    frame_first: int = field(6, "first frame covered, counted from 0; -1 for none", -1)
    frame_last: int = field(7, "last frame covered, inclusive; -1 for none", -1)
    pts_ns: int = field(8, "stream clock at the start of what is covered", 0)
    camera_time_ns: int = field(9, "camera's wall clock then, UTC since 1970; 0 is unknown", 0)
    arrival_time_ns: int = field(10, "this host's clock at arrival; not part of the content", 0)
    rate_basis: str = field(
        11,
        "'declared', 'assumed' or 'given': pts_ns counts frames at such a rate; "
        "empty: the frames have times of their own",
        RateBasis.STAMPED,
    )

    def numbered(self, seq: int, mark: Mark = Mark.DATA) -> Header:
        """Return the header with another sequence number and mark."""
        return dataclasses.replace(self, seq=seq, mark=int(mark))

    def at(self, pts_ns: int, **others: Any) -> Header:
        """Return the header at another time of its stream, with other fields besides."""
        camera_ns = self.camera_time_ns and self.camera_time_ns + pts_ns - self.pts_ns
        return dataclasses.replace(self, pts_ns=pts_ns, camera_time_ns=camera_ns, **others)

    @property
    def is_end(self) -> bool:
        """Whether the message marks the end of its topic's stream."""
        return self.mark == Mark.END

"""Detects frozen and looped pictures by identical row means, without any reference.

Model: light and sensor noise make all frames differ, so identical row means (to 1e-4 levels) are
the same picture.

Statistic: the number of different pictures over some seconds: up to a tenth of the frames means a
frozen feed (not one only: a codec sends a still picture again with each key frame, and refines it
afterwards). And the time since the same picture: if it stays the same to 0.1 s for long, a loop.

Approximate: no probability is stated. One picture in 0.1 s is remembered, for an hour: longer
periods, and loops of which an encoder changed every picture, aren't found here.

References
----------
Wang, W. and Farid, H. (2007), Exposing digital forgeries in video by detecting duplication, ACM
Workshop on Multimedia and Security.
"""

from __future__ import annotations

import itertools
from collections import deque
from dataclasses import dataclass

import numpy as np

from rsenf.live.past import RecentValues
from rsenf.messages import RowBlock
from rsenf.messages.schema import Float32Array
from rsenf.timebase import nanoseconds, seconds

KEEP_NS = nanoseconds(3600.0)
REMEMBER_NS = nanoseconds(0.1)  # one frame is stored per interval: a loop repeats all of them
LEAST_PERIOD_NS = nanoseconds(1.0)
FEW_RATIO = 0.1  # share of different pictures up to which the feed is frozen
ALIKE_LEVELS = 1e-4
# A loop that was encoded again repeats only some of its pictures exactly.
HOLD_NS = nanoseconds(30.0)
STANDS_RATIO = 0.6  # of the time to frozen: if still for this long, repeats come from GOPs, no loop
JITTER_NS = nanoseconds(0.1)  # allowed variation of the period


@dataclass(frozen=True)
class PictureFacts:
    """Findings about the pictures up to a time.

    Attributes
    ----------
    frozen_since_ns : int or None
        Stream clock since when the picture is frozen.
    loop_since_ns : int or None
        Stream clock since when pictures repeat.
    period_s : float
        Period of the loop; NaN for none.
    """

    frozen_since_ns: int | None = None
    loop_since_ns: int | None = None
    period_s: float = float("nan")


class RepeatDetector:
    """Detects frozen and looped pictures in the row blocks of one epoch.

    Parameters
    ----------
    frozen_s, loop_s : float
        Time that either must last to be reported.
    """

    def __init__(self, frozen_s: float, loop_s: float) -> None:
        self._frozen_ns, self._loop_ns = nanoseconds(frozen_s), nanoseconds(loop_s)
        self._before: Float32Array | None = None
        # Pictures are identified by Python's hash of their bytes, which is randomised per process.
        self._digest = 0  # of the previous picture
        self._late: deque[tuple[int, int]] = deque()  # frames of the last frozen_s
        self._pictures: dict[int, int] = {}  # number of occurrences among them
        self._seen = RecentValues(KEEP_NS // REMEMBER_NS, np.int64)
        self._seen_ns: int | None = None  # when one was last added
        self._again: tuple[int, int, int] | None = None  # since, until, period
        self._loop: tuple[int, int, int] | None = None  # the same, while reported as a loop
        self._began_ns: int | None = None
        self.facts = PictureFacts()

    def add(self, block: RowBlock) -> None:
        """Take a block, and look for its like among earlier ones (Wang and Farid 2007)."""
        if not block.frames:
            return
        alike = self._alike(block.level)
        for pts_ns, level, same in zip(
            block.frame_pts_ns.tolist(), block.level, alike, strict=True
        ):
            if self._began_ns is None:
                self._began_ns = pts_ns
            if not same:
                self._digest = hash(level.tobytes())
                self._look_up(pts_ns, self._digest)
            self._keep(pts_ns, self._digest)
        self._before = block.level[-1]
        self._conclude(int(block.frame_pts_ns[-1]))

    def _keep(self, pts_ns: int, digest: int) -> None:
        """Store a frame, and drop those that are too old."""
        self._late.append((pts_ns, digest))
        self._pictures[digest] = self._pictures.get(digest, 0) + 1
        while self._late[0][0] < pts_ns - self._frozen_ns:
            _, old = self._late.popleft()
            self._pictures[old] -= 1
            if not self._pictures[old]:
                del self._pictures[old]

    def _alike(self, level: Float32Array) -> list[bool]:
        """Whether each frame is identical to the one before it."""
        before = self._before
        if before is None or before.shape != level.shape[1:]:
            before = np.full(level.shape[1:], np.inf, np.float32)
        # Fast path: different pictures almost always differ at any single place.
        place = level.shape[1] // 2, 0
        here = [float(before[place]), *level[:, *place].tolist()]
        if not any(abs(a - b) < 2.0 * ALIKE_LEVELS for a, b in itertools.pairwise(here)):
            return [False] * len(level)
        steps = level - np.concatenate([before[None], level[:-1]])
        far = np.abs(steps, out=steps).reshape(len(level), -1).max(axis=1)
        return [bool(alike) for alike in far < ALIKE_LEVELS]

    def _look_up(self, pts_ns: int, digest: int) -> None:
        """Look for an identical earlier frame, and note the period if there is one."""
        t_ns, digests = self._seen.held
        then_ns = t_ns[digests == digest]
        period_ns = pts_ns - int(then_ns.max()) if then_ns.size else 0
        if LEAST_PERIOD_NS <= period_ns <= KEEP_NS:
            self._note_again(pts_ns, period_ns)
        if self._seen_ns is None or pts_ns - self._seen_ns >= REMEMBER_NS:
            self._seen.add(pts_ns, digest)
            self._seen_ns = pts_ns

    def _note_again(self, pts_ns: int, period_ns: int) -> None:
        since_ns = pts_ns
        if self._again is not None:
            began_ns, until_ns, before_ns = self._again
            if pts_ns - until_ns < self._loop_ns and abs(period_ns - before_ns) < JITTER_NS:
                since_ns = began_ns
        self._again = since_ns, pts_ns, period_ns

    def _conclude(self, now_ns: int) -> None:
        frozen_since = None
        if self._again is not None:
            since_ns, until_ns, period_ns = self._again
            stands = self._stands_since(now_ns - round(STANDS_RATIO * self._frozen_ns))
            if until_ns - since_ns >= self._loop_ns and not stands:
                began_ns = since_ns if self._loop is None else self._loop[0]
                self._loop = began_ns, until_ns, period_ns
        if self._loop is not None and now_ns - self._loop[1] > HOLD_NS:
            self._loop = None
        full = self._began_ns is not None and now_ns - self._began_ns >= self._frozen_ns
        seen_ns = now_ns - self._late[0][0]  # short after a gap in the frames
        stood_long = _few(len(self._pictures), len(self._late))
        if full and 2 * seen_ns > self._frozen_ns and stood_long:
            stood = self.facts.frozen_since_ns
            frozen_since = stood if stood is not None else self._late[0][0]
            self._again = self._loop = None
        self.facts = PictureFacts(frozen_since)
        if self._loop is not None:
            began_ns, _, period_ns = self._loop
            self.facts = PictureFacts(frozen_since, began_ns, seconds(period_ns))

    def _stands_since(self, since_ns: int) -> bool:
        """Whether the frames since a time show few different pictures."""
        pictures = [digest for pts_ns, digest in self._late if pts_ns >= since_ns]
        return _few(len(set(pictures)), len(pictures))


def _few(different: int, frames: int) -> bool:
    """Whether a number of different pictures is small enough for a frozen feed."""
    return different <= max(1.0, FEW_RATIO * frames)

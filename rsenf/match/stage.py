"""The match stage: estimates and reference blocks in, match results out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from rsenf.errors import SchemaMismatch, UsageError
from rsenf.match.clip_phase import clip_phase
from rsenf.match.correlate import matcher_ncc
from rsenf.match.estimates import EstimateStore, Rows
from rsenf.match.examine import examined
from rsenf.match.matcher import (
    Finding,
    HypothesisMatcher,
    Matcher,
    compare_directions,
    nothing_to_decide,
    of_nominal,
)
from rsenf.match.paper import Metric
from rsenf.match.paper_search import HypothesisStore
from rsenf.match.phase import match_phase
from rsenf.match.result import result_of
from rsenf.match.series import Grid, Track, grid_of, track_of_rows, without_jumps
from rsenf.match.settings import MatchSettings
from rsenf.messages import EnfEstimate, MatchResult, ReferenceBlock
from rsenf.registry import Registry
from rsenf.timebase import nanoseconds

NAN = float("nan")
MOST_PAUSE_NS = 3_600 * 10**9  # between estimates; unusable ones are sent too
INTERIM_SHARE = 0.25  # least growth of a clip since the last interim result

METHODS: Registry[Matcher | HypothesisMatcher] = Registry(
    "match method",
    "rsenf.matchers",
    {
        "phase": match_phase,
        "ncc": matcher_ncc,
        **{f"metric{number}": Metric(number) for number in (1, 2, 3, 4)},
    },
)


def tracker_for(method: str) -> str:
    """Return the ENF method that a matcher needs; empty if any will do."""
    matcher = METHODS.get(method)
    return matcher.enf_method if isinstance(matcher, HypothesisMatcher) else ""


class Match:
    """Collects a clip's ENF and references, and compares them. A :class:`rsenf.stage.Stage`.

    Parameters
    ----------
    method : str
        Name of the matcher. Estimates without a phase are compared by ``ncc`` instead of ``phase``,
        and the result says so. A :class:`rsenf.match.matcher.HypothesisMatcher` gets all hypotheses
        of its ENF method, any other matcher only the tracker's result (rank 0).
    grid : str
        Name of the reference to use; empty for all.
    grids : sequence of Grid
        References that are available from the start, in addition to those that arrive as blocks.
    claimed_utc_ns : int
        Claimed time of the first frame, UTC since 1970; 0 for none.
    interim_every_s : float
        Stream time between interim results; 0 for the final one only. For a long clip each waits
        until the clip is a quarter longer than at the previous one.
    settings : MatchSettings, optional
    alternatives : int
        Number of tracks of the same clip, under different assumptions, that are compared (1 for
        this one only); it multiplies the number of chance fits.
    keep_hours : float
        Hours of the estimates, and of a growing reference, to keep; 0 for all. A longer clip is
        compared by its last hours, and the result says so. Hypotheses of the tracker ``paper`` are
        all kept, in a few bytes each.
    edits : bool
        Look for edits of the clip, in the final result.
    on_refused : callable, optional
        Called with the reason if a clip and a reference can't be compared at all; the result is
        then ``no_decision``. For a node that serves other cameras too. If None, that is an error.

    Raises
    ------
    UsageError
        If there is no method of that name; from ``update`` and ``flush``, if neither of the steps
        of clip and reference is a whole multiple of the other.
    """

    def __init__(
        self,
        *,
        method: str = "phase",
        grid: str = "",
        grids: Sequence[Grid] = (),
        claimed_utc_ns: int = 0,
        interim_every_s: float = 0.0,
        settings: MatchSettings | None = None,
        alternatives: int = 1,
        keep_hours: float = 0.0,
        edits: bool = True,
        on_refused: Callable[[str], None] | None = None,
    ) -> None:
        METHODS.find(method)
        self.method, self.grid, self.claimed_utc_ns = method, grid, claimed_utc_ns
        self._claimed_ns = claimed_utc_ns  # for this epoch; 0 after the first
        self.settings = settings or MatchSettings()
        self._alternatives = alternatives
        self._edits = edits
        self._every_ns = nanoseconds(interim_every_s)
        self._keep_ns = nanoseconds(3600.0 * keep_hours)
        self._on_refused = on_refused
        self._grids = tuple(grids)
        self._blocks: dict[str, dict[int, ReferenceBlock]] = {}
        self._begin()

    def _begin(self) -> None:
        self._estimates = EstimateStore()
        self._last: EnfEstimate | None = None
        self._hypotheses = HypothesisStore()
        self._epoch: tuple[str, int] | None = None
        self._due: list[int] = []  # numbers of estimates at which interim results are due
        self._last_due = 0  # interim periods that had passed when the last result was due
        self._published = 0
        self._forgotten = 0  # estimates of this epoch that were dropped as too old

    def update(self, message: EnfEstimate | ReferenceBlock) -> list[Any]:
        """Take an estimate or a block of reference; return the results that it completes.

        A new epoch of the estimates (a loop, a seek, a reconnection) ends the one before, and so
        does a new run, if a node upstream was restarted. Interim results wait for a reference that
        is still arriving, so that they don't depend on which of the two streams is ahead.
        """
        if isinstance(message, ReferenceBlock):
            self._take_block(message)
            return self._interim()
        out = []
        epoch = (message.header.run_id, message.header.epoch)
        if self._epoch not in (None, epoch):
            out = self.flush()
            self._begin()
            self._claimed_ns = 0
        self._epoch = epoch
        _ensure_follows(message, self._last)
        if message.rank != 0:
            if tracker_for(self.method):
                self._hypotheses.add(message)
            return out
        if self._every_ns and self._is_due(message):
            self._due.append(self._forgotten + self._estimates.rows.size + 1)
        self._estimates.add(message)
        self._last = message
        out += self._interim()
        self._forget()
        return out

    def _forget(self) -> None:
        """Drop estimates older than the hours kept, once they are an eighth of all."""
        rows = self._estimates.rows
        oldest_ns = rows["end_ns"][-1] - self._keep_ns
        if not self._keep_ns or rows["start_ns"][rows.size // 8] >= oldest_ns:
            return
        old = min(int(np.searchsorted(rows["start_ns"], oldest_ns)), rows.size - 1)
        self._estimates.forget(old)
        self._forgotten += old
        self._due = [count for count in self._due if count > self._forgotten]

    def flush(self) -> list[Any]:
        """Return the final result of the epoch."""
        return [self._result(self._estimates.rows, final=True)]

    def _take_block(self, block: ReferenceBlock) -> None:
        if self.grid not in ("", block.grid) or not block.samples:
            return
        kept = self._blocks.setdefault(block.grid, {})
        one = next(iter(kept.values()), block)
        if _axis(block) != _axis(one):
            if block.header.run_id == one.header.run_id:
                raise SchemaMismatch("a block of another reference")
            kept.clear()  # its node was restarted, with another start time
        kept[block.first] = block
        if self._keep_ns and block.t0_ns and not block.total:
            least = block.first + block.samples - self._keep_ns // block.step_ns
            for first in [f for f, b in kept.items() if f + b.samples < least]:
                del kept[first]

    def _is_due(self, message: EnfEstimate) -> bool:
        """Whether this is the first window to reach a multiple of the interim period.

        Each result compares the whole clip again. Results at every period would cost time quadratic
        in the clip's length, so each also waits for the clip to grow by a share of its length.
        """
        before = self._last.end_pts_ns if self._last else message.origin_pts_ns
        now, last = (
            (t_ns - message.origin_pts_ns) // self._every_ns
            for t_ns in (message.end_pts_ns, before)
        )
        length = min(self._last_due, self._keep_ns // self._every_ns or self._last_due)
        if now <= last or now - self._last_due < INTERIM_SHARE * length:
            return False
        self._last_due = now
        return True

    def _interim(self) -> list[Any]:
        if not self._due or not self._reference_ready():
            return []
        counts = [count - self._forgotten for count in self._due]
        out = [self._result(self._estimates.rows[:count], final=False) for count in counts]
        self._due = []
        return out

    def _reference_ready(self) -> bool:
        """Whether every reference is complete; a growing one (no total) always counts as such."""
        every = [blocks.values() for blocks in self._blocks.values()]
        is_whole = all(sum(b.samples for b in of) >= max(b.total for b in of) for of in every)
        return is_whole and bool(self._blocks or self._grids)

    def _result(self, rows: Rows, *, final: bool) -> MatchResult:
        rows, cut = self._recent(rows)
        track, jumps = (track_of_rows(rows), 0) if rows.size else (None, 0)
        if track and not tracker_for(self.method):
            track, jumps = without_jumps(track)
            track = dataclasses.replace(track, alternatives=self._alternatives)
        grids = [*self._grids, *(grid_of(list(b.values())) for b in self._blocks.values())]
        no_phase = track is not None and track.usable and clip_phase(track) is None
        method = "ncc" if self.method == "phase" and no_phase else self.method
        try:
            finding, track = self._finding(method, track, rows, grids)
            if final and self._edits and method == "phase" and track and finding.grid:
                alike = of_nominal(track, grids)
                finding = examined(finding, track, alike, self.settings, self._claimed_ns)
        except UsageError as exc:
            if self._on_refused is None:
                raise
            self._on_refused(str(exc))
            finding = Finding(decision="no_decision", reason=str(exc))
        warnings = [cut] if cut else []
        if method != self.method:
            warnings.append(f"these estimates carry no phase: compared by {method}")
        finding = dataclasses.replace(finding, warnings=(*finding.warnings, *warnings))
        header = self._estimates.header(rows, self._published)
        self._published += 1
        return result_of(
            finding,
            header=header,
            method=method,
            grid=finding.grid or (grids[0] if grids else Grid(self.grid, NAN, 0, 1.0, np.empty(0))),
            track=track,
            jumps=jumps,
            settings=self.settings,
            claimed_utc_ns=self.claimed_utc_ns,
            is_later=self._claimed_ns != self.claimed_utc_ns,
            final=final,
        )

    def _recent(self, rows: Rows) -> tuple[Rows, str]:
        """Return the estimates of the last hours, and a warning if others were left out."""
        if not self._keep_ns or not rows.size:
            return rows, ""
        oldest_ns = rows["end_ns"][-1] - self._keep_ns
        old = min(int(np.searchsorted(rows["start_ns"], oldest_ns)), rows.size - 1)
        if not self._forgotten and not old:
            return rows, ""
        return rows[old:], f"longer than {self._keep_ns / 3.6e12:g} h: compared by what came last"

    def _finding(
        self, method: str, track: Track | None, rows: Rows, grids: list[Grid]
    ) -> tuple[Finding, Track | None]:
        """Compare, or give the reason why not; return the track in the chosen direction too."""
        matcher, reason = METHODS[method], ""
        if track is None:
            reason = "no ENF estimate: the clip is shorter than one window"
        elif not grids:
            reason = "no reference"
        elif isinstance(matcher, HypothesisMatcher):
            hypotheses = self._hypotheses.hypotheses(int(rows["end_ns"][-1]))
            if hypotheses:
                found = matcher(hypotheses, grids, self.settings)
                is_sure, said = track.usable, self._estimates.said(rows[-1])
                return (found if is_sure else _doubted(found, said[1])), track
            reason = self._why_no_hypotheses(method, matcher.enf_method, rows[-1])
        else:
            reason = nothing_to_decide(track, grids, self.settings)
            if not track.usable:
                reason = ": ".join(filter(None, (reason, self._estimates.usual_reason(rows))))
            if not reason:
                alike = of_nominal(track, grids)
                compare = partial(
                    matcher, grids=alike, settings=self.settings, claimed_utc_ns=self._claimed_ns
                )
                return compare_directions(compare, track, self.settings.tolerance_s)
        return Finding(decision="no_decision", reason=reason), track

    def _why_no_hypotheses(self, method: str, needed: str, last: Any) -> str:
        other, reason = self._estimates.said(last)
        if other != needed:
            return f"{method} compares the hypotheses of {needed!r}, not an ENF by {other!r}"
        return f"no usable signal: {reason}"


def _ensure_follows(message: EnfEstimate, last: EnfEstimate | None) -> None:
    """Refuse an estimate with another origin, or with a time that doesn't follow the last one."""
    if last is None:
        return
    pause_ns = message.start_pts_ns - last.start_pts_ns
    if message.origin_pts_ns != last.origin_pts_ns or not 0 <= pause_ns <= MOST_PAUSE_NS:
        raise SchemaMismatch("an estimate out of place")


def _axis(block: ReferenceBlock) -> tuple[int, int, str]:
    return block.t0_ns, block.step_ns, str(block.nominal_hz)


def _doubted(found: Finding, reason: str) -> Finding:
    """Add the warning that no hypothesis stood out of the noise."""
    warning = f"no line of the flicker is sure to be there: {reason}"
    return dataclasses.replace(found, warnings=(*found.warnings, warning))

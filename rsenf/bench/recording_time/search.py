"""One clip searched for in one reference, by any matcher; what they share is done once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

from rsenf.bench.recording_time.plan import NOMINAL_HZ
from rsenf.match import Finding, MatchSettings
from rsenf.match.paper import Metric, metric
from rsenf.match.paper_search import Tally, paper_search
from rsenf.match.paper_tracks import Hypotheses, hypotheses_of
from rsenf.match.series import grid_of
from rsenf.match.stage import Match
from rsenf.messages import EnfEstimate, MatchResult, RowBlock
from rsenf.reference import Reference, reference_blocks
from rsenf.track import TrackSettings, make_tracker

PAPER_METRICS = ("metric1", "metric2", "metric3", "metric4")

# What a matcher says; of the metrics it is the finding alone.
Said = MatchResult | Finding


class ClipEnf:
    """A clip's ENF: by the default tracker, and under each of the paper's hypotheses.

    Parameters
    ----------
    blocks : sequence of RowBlock
    """

    def __init__(self, blocks: Sequence[RowBlock]) -> None:
        self._blocks = blocks

    @cached_property
    def estimates(self) -> list[EnfEstimate]:
        """What the default tracker says."""
        return list(self._tracked(TrackSettings.method))

    @cached_property
    def hypotheses(self) -> Hypotheses | None:
        """What the paper's tracker says of each hypothesis; None of a clip without a window."""
        return hypotheses_of(self._tracked(Metric.enf_method))

    def _tracked(self, method: str) -> Iterator[EnfEstimate]:
        stage = make_tracker(TrackSettings(method=method, nominal_hz=NOMINAL_HZ))
        for block in self._blocks:
            yield from stage.update(block)
        yield from stage.flush()


class Search:
    """A clip and a reference.

    Parameters
    ----------
    clip : ClipEnf
    reference : Reference
    """

    def __init__(self, clip: ClipEnf, reference: Reference) -> None:
        self._clip = clip
        self._blocks = list(reference_blocks(reference, source="reference"))

    def by(self, method: str) -> list[Said]:
        """Return what a matcher says, as the match stage would; the metrics share one search."""
        if method in PAPER_METRICS:
            return [self._metric(PAPER_METRICS.index(method) + 1)]
        stage = Match(method=method)
        for estimate in self._clip.estimates:
            stage.update(estimate)
        for block in self._blocks:
            stage.update(block)
        return stage.flush()

    def _metric(self, number: int) -> Finding:
        if self._tally is None:
            return Finding(decision="no_decision", reason="no window of ENF")
        return metric(self._tally, number)

    @cached_property
    def _tally(self) -> Tally | None:
        if self._clip.hypotheses is None:
            return None
        return paper_search(self._clip.hypotheses, grid_of(self._blocks), MatchSettings())

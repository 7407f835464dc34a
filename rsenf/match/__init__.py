"""Match: compares a clip's ENF with references of grid frequency, by a method chosen by name.

In: ENF estimates of one clip and blocks of one or more references. Out: ``MatchResult`` messages:
the lag with its standard error, likelihood ratios, a decision, and apparent edits of the clip.

Read ``series`` (clip and reference on uniform axes) and ``matcher`` (the interface, ``Finding``)
first, then ``stage``. Matcher ``phase``: ``clip_phase``, ``forecast``, ``phase_filter``,
``ou_likelihood``, ``phase_scorer``, ``phase_search``, ``calibration``, ``phase``; then ``parts``
and ``examine`` for edited clips. Matcher ``ncc``: ``ncc``, ``score``,
``search``, ``correlate``. Metrics 1 to 4: ``paper_search``, ``paper``. ``against`` compares
recordings with each other; ``estimates`` keeps a clip's, ``result`` makes the message.
"""

from __future__ import annotations

from rsenf.match.matcher import Finding, HypothesisMatcher, Matcher
from rsenf.match.paper import Metric, metric
from rsenf.match.paper_search import Hypotheses, Tally, hypotheses_of, paper_search
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.match.stage import METHODS, Match, tracker_for

__all__ = [
    "METHODS",
    "Finding",
    "Grid",
    "HypothesisMatcher",
    "Hypotheses",
    "Match",
    "MatchSettings",
    "Matcher",
    "Metric",
    "Tally",
    "Track",
    "hypotheses_of",
    "metric",
    "paper_search",
    "tracker_for",
]

"""Match: a clip's ENF against a reference of grid frequency, by a method chosen by name."""

from __future__ import annotations

from rsenf.match.matcher import Finding, HypothesisMatcher, Matcher, check_lengths
from rsenf.match.ncc import LagTable, masked_ncc
from rsenf.match.paper import Metric, metric
from rsenf.match.paper_search import Tally, paper_search
from rsenf.match.paper_tracks import Hypotheses, hypotheses_of
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.match.stage import METHODS, Match, tracker_for

__all__ = [
    "METHODS",
    "Finding",
    "Grid",
    "HypothesisMatcher",
    "Hypotheses",
    "LagTable",
    "Match",
    "MatchSettings",
    "Matcher",
    "Metric",
    "Tally",
    "Track",
    "check_lengths",
    "hypotheses_of",
    "masked_ncc",
    "metric",
    "paper_search",
    "tracker_for",
]
